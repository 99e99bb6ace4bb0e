"""A run is a directory: settings, metrics, checkpoint, policy, and where the code stood."""

import csv
import io
import json
import math
import platform
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.files import write_whole
from rled_msgs_py.outputs import require_output
from rled_msgs_py.untrusted import read_json, read_text

from rled_agent.methods.method import Method
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, read_state, write_checkpoint
from rled_agent.training.config import TrainConfig
from rled_agent.training.learning_state import restoring, whole_number
from rled_agent.training.tables import read_rows

FILES = (
    "config.json", "expert.json", "metrics.csv", "checkpoint.safetensors", "policy.safetensors", "best.safetensors"
)  # fmt: skip


class RunDirectory:
    """Files of one run.

    ``config.json`` (settings, bag, versions), ``expert.json`` (what the expert comes to in an evaluation),
    ``metrics.csv`` (a row an interval), TensorBoard events, ``checkpoint.safetensors`` (the last good one) and, for
    this project's robots, ``policy.safetensors`` (of the checkpoint) and ``best.safetensors`` (of the best evaluation).
    ``diverged.json`` is there where the run has ended since a loss was no number.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config_path = path / "config.json"
        self.metrics_path = path / "metrics.csv"
        self.checkpoint_path = path / "checkpoint.safetensors"
        self.policy_path = path / "policy.safetensors"
        self.best_path = path / "best.safetensors"
        self.diverged_path = path / "diverged.json"
        self._rows: list[dict[str, float]] = []

    def require_new(self) -> None:
        """Refuse a folder where no run can begin, before the work.

        Raises:
            RledError: the directory holds a run already, or can't be written into.
        """
        require_output(self.path, *FILES)
        if self.config_path.exists():
            raise RledError(f"{self.path} holds a run already", "a new --output", "or continue it with --resume")

    def require_resumable(self) -> None:
        """Refuse a folder where no run can go on, before the work.

        Raises:
            RledError: no run here, one without a checkpoint, or a folder that can't be written into.
        """
        self.config()
        if not self.checkpoint_path.is_file():
            what = f"the run in {self.path} has no checkpoint yet"
            raise RledError(what, "a run that has saved one", "remove the folder and leave out --resume")
        require_output(self.path, *FILES)

    def create(self, config: dict[str, Any]) -> None:
        """Begin a new run.

        Raises:
            RledError: as ``require_new``.
        """
        self.require_new()
        record = config | {"git": _git_revision(), "python": platform.python_version(), "torch": torch.__version__}
        write_whole(self.config_path, json.dumps(record, indent=2) + "\n")

    def write_expert(self, result: dict[str, float]) -> None:
        """Keep what the expert alone comes to in the episodes of an evaluation."""
        write_whole(self.path / "expert.json", json.dumps(result, indent=2) + "\n")

    def write_diverged(self, step: int) -> None:
        """Keep that a loss was found to be no number at that step: the run has ended."""
        write_whole(self.diverged_path, json.dumps({"step": step}) + "\n")

    def config(self) -> dict[str, Any]:
        """The settings that ``create`` wrote.

        Raises:
            RledError: no run here, or a file that no run wrote.
        """
        try:
            values = read_json(read_text(self.config_path, "config.json"), "config.json")
        except (OSError, RledError) as error:
            raise RledError(f"{self.path} holds no run ({error})", "a folder that train_agent wrote") from None
        if not isinstance(values, dict):
            raise RledError(f"{self.config_path} holds no settings", "a folder that train_agent wrote")
        return values

    def settings(self, methods: Mapping[str, type[Method]]) -> TrainConfig:
        """The settings of a run, wherever it comes from.

        Args:
            methods: all there are, by name.

        Raises:
            RledError: no run here, or settings of another version, or out of their range.
        """
        try:
            return TrainConfig.from_dict(self.config().get("config"), methods)
        except ContractError as error:
            raise RledError(f"{self.config_path}: {error.what}", error.accepted, error.remedy) from None

    def save(self, checkpoint: Checkpoint) -> None:
        """Replace the checkpoint."""
        write_checkpoint(self.checkpoint_path, checkpoint)

    def step(self) -> int:
        """Of the checkpoint.

        Raises:
            RledError: it is damaged.
        """
        with restoring(str(self.checkpoint_path)):
            return whole_number(read_state(self.checkpoint_path), "run.step")

    def load(self) -> Checkpoint:
        """Read the checkpoint, and drop the metrics that came after it and what a killed process had half written.

        Raises:
            RledError: the checkpoint or the metrics are damaged.
        """
        checkpoint = read_checkpoint(self.checkpoint_path)
        for path in (self.checkpoint_path, self.policy_path, self.best_path, self.metrics_path):
            for leftover in self.path.glob(f".{path.stem}-*{path.suffix}"):
                leftover.unlink()
        if self.metrics_path.exists():
            with restoring(str(self.checkpoint_path)):
                step = whole_number(checkpoint.state, "run.step")
            self._rows = [row for row in read_rows(self.metrics_path, "step") if row["step"] <= step]
            self._write_metrics()
        return checkpoint

    def append(self, row: dict[str, float]) -> None:
        """Add a row of metrics; the file on disk is whole at every moment."""
        self._rows.append(row)
        self._write_metrics()

    def ends_in_the_best(self) -> bool:
        """Whether the last row has an evaluation, of a greater return than any before or as great in fewer steps."""
        *before, last = map(_score, self._rows)
        return math.isfinite(last[0]) and all(last > each for each in before if math.isfinite(each[0]))

    def _write_metrics(self) -> None:
        text = io.StringIO()
        names = dict.fromkeys(["step", *(name for row in self._rows for name in row)])
        writer = csv.DictWriter(text, fieldnames=list(names), restval="nan")
        writer.writeheader()
        writer.writerows(self._rows)
        write_whole(self.metrics_path, text.getvalue())


def _score(row: dict[str, float]) -> tuple[float, float]:
    return row.get("evaluation_reward", math.nan), -row.get("evaluation_steps", math.nan)


def _git_revision() -> str:
    command = ["git", "describe", "--always", "--dirty"]
    try:
        asked = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True)
    except OSError:  # there is no git
        return "unknown"
    return asked.stdout.strip() or "unknown"
