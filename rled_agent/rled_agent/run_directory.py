"""A run is a directory: settings, metrics, checkpoint, policy, and where the code stood."""

import csv
import io
import json
import math
import platform
import subprocess
from pathlib import Path
from typing import Any

import torch
from rled_msgs_py.errors import RledError
from rled_msgs_py.files import write_whole

from rled_agent.checkpoint import Checkpoint, read_checkpoint, write_checkpoint


class RunDirectory:
    """Files of one run.

    ``config.json`` (settings, bag, versions), ``expert.json`` (what the expert comes to in an evaluation),
    ``metrics.csv`` (a row an interval), TensorBoard events, ``checkpoint.safetensors`` (the last good one) and, for
    this project's robots, ``policy.safetensors`` (of the checkpoint) and ``best.safetensors`` (of the best evaluation).
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config_path = path / "config.json"
        self.metrics_path = path / "metrics.csv"
        self.checkpoint_path = path / "checkpoint.safetensors"
        self.policy_path = path / "policy.safetensors"
        self.best_path = path / "best.safetensors"
        self._rows: list[dict[str, float]] = []

    def create(self, config: dict[str, Any]) -> None:
        """Begin a new run.

        Raises:
            RledError: the directory holds a run already.
        """
        if self.config_path.exists():
            raise RledError(f"{self.path} holds a run already", "a new --output", "or continue it with --resume")
        record = config | {"git": _git_revision(), "python": platform.python_version(), "torch": torch.__version__}
        write_whole(self.config_path, json.dumps(record, indent=2) + "\n")

    def write_expert(self, result: dict[str, float]) -> None:
        """Keep what the expert alone comes to in the episodes of an evaluation."""
        write_whole(self.path / "expert.json", json.dumps(result, indent=2) + "\n")

    def config(self) -> dict[str, Any]:
        """The settings that ``create`` wrote.

        Raises:
            RledError: no run here.
        """
        try:
            values: dict[str, Any] = json.loads(self.config_path.read_text())
        except (OSError, ValueError) as error:
            raise RledError(f"{self.path} holds no run ({error})", "a folder that train_agent wrote") from None
        return values

    def save(self, checkpoint: Checkpoint) -> None:
        """Replace the checkpoint."""
        write_checkpoint(self.checkpoint_path, checkpoint)

    def load(self) -> Checkpoint:
        """Read the checkpoint, and drop the metrics that came after it and what a killed process had half written."""
        checkpoint = read_checkpoint(self.checkpoint_path)
        for path in (self.checkpoint_path, self.policy_path, self.best_path, self.metrics_path):
            for leftover in self.path.glob(f".{path.stem}-*{path.suffix}"):
                leftover.unlink()
        if self.metrics_path.exists():
            with self.metrics_path.open(newline="") as file:
                rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
            self._rows = [row for row in rows if row["step"] <= checkpoint.state["step"]]
            self._write_metrics()
        return checkpoint

    def append(self, row: dict[str, float]) -> None:
        """Add a row of metrics; the file on disk is whole at every moment."""
        self._rows.append(row)
        self._write_metrics()

    def ends_in_the_best(self) -> bool:
        """Whether the last row has an evaluation, of a greater return than any before or as great in fewer steps."""
        scores = [(row["evaluation_reward"], -row["evaluation_steps"]) for row in self._rows]
        *before, last = scores
        return math.isfinite(last[0]) and all(last > each for each in before if math.isfinite(each[0]))

    def _write_metrics(self) -> None:
        text = io.StringIO()
        names = dict.fromkeys(["step", *(name for row in self._rows for name in row)])
        writer = csv.DictWriter(text, fieldnames=list(names), restval="nan")
        writer.writeheader()
        writer.writerows(self._rows)
        write_whole(self.metrics_path, text.getvalue())


def _git_revision() -> str:
    asked = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=Path(__file__).parent, capture_output=True, text=True
    )
    return asked.stdout.strip() or "unknown"
