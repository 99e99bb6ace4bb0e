"""Runs that are kept: one file an experiment, one line of JSON a run, with all that its figures are drawn from.

A line holds the run's variant and seed, its command and where it was made (``run``), the content of each JSON file that
it wrote (``documents``, of which ``config`` has the settings and the revision of the code) and the columns of each CSV
file (``tables``), where null stands for NaN.
"""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rled_msgs_py.errors import RledError
from rled_msgs_py.files import write_whole
from rled_msgs_py.untrusted import read_json, read_text

from rled_agent.experiments.experiment import Run, RunName
from rled_agent.experiments.statistics import Curve, Floats
from rled_agent.training.tables import MAX_BYTES, read_rows

RECORD = "run.json"
"""File of a run's folder that says how it was made; a run that is done has one."""
RECORDED = {"command": list, "seconds": int | float, "processor": str}
METRICS = "metrics"


class KeptRun(NamedTuple):
    """What is kept of one run.

    Attributes:
        name: which run.
        record: its command, seconds and processor.
        documents: JSON content by the stem of its file.
        tables: columns by name, by the stem of their file.
    """

    name: RunName
    record: Mapping[str, Any]
    documents: Mapping[str, Any]
    tables: Mapping[str, Mapping[str, Floats]]

    def columns(self, stem: str, *names: str) -> Mapping[str, Floats]:
        """A table.

        Raises:
            RledError: it is not kept, has no rows, or lacks a column.
        """
        table = self.tables.get(stem, {})
        missing = [name for name in names if not len(table.get(name, ()))]
        if missing:
            raise RledError(f"{self.name} has no {', '.join(missing)} in its {stem}", "a run that has logged something")
        return table

    def curve(self, metric: str) -> Curve:
        """One metric over environment steps, where it was measured.

        Raises:
            RledError: it was not logged.
        """
        columns = self.columns(METRICS, "step", metric)
        measured = np.isfinite(columns[metric])
        return Curve(columns["step"][measured], columns[metric][measured])

    def is_of(self, run: Run) -> bool:
        """Whether that run's command made it."""
        return bool(self.record["command"] == list(run.command))


Runs = Mapping[str, Sequence[KeptRun]]
"""The runs of each variant, by its label."""


def is_record(content: Any) -> bool:
    """Whether this is how a run was made."""
    return isinstance(content, dict) and all(isinstance(content.get(each), kind) for each, kind in RECORDED.items())


def read_folder(folder: Path, name: RunName) -> KeptRun:
    """What is to be kept of a run's folder: its settings and figures, not its weights.

    Raises:
        RledError: a file of it is damaged.
    """
    documents = {path.stem: read_json(read_text(path, str(path)), str(path)) for path in sorted(folder.glob("*.json"))}
    tables = {path.stem: _transposed(read_rows(path)) for path in sorted(folder.glob("*.csv"))}
    return KeptRun(name, documents.pop(Path(RECORD).stem), documents, tables)


class Archive:
    """The kept runs of all experiments.

    Args:
        folder: where their files are.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, dict[RunName, KeptRun]] = {}

    def read(self, experiment: str) -> Mapping[RunName, KeptRun]:
        """Runs of one experiment, by name; its file is read once.

        Raises:
            RledError: it cannot be read, or a line is no run.
        """
        if experiment not in self._known:
            self._known[experiment] = self._read(experiment)
        return self._known[experiment]

    def has(self, run: Run) -> bool:
        """The run is kept, made by the same command as now."""
        kept = self.read(run.name.experiment).get(run.name)
        return kept is not None and kept.is_of(run)

    def add(self, run: KeptRun) -> None:
        """Keep a run, in place of an older one of its name."""
        runs = {**self.read(run.name.experiment), run.name: run}
        lines = [json.dumps(_line(runs[name]), allow_nan=False) for name in sorted(runs)]
        write_whole(self._path(run.name.experiment), "".join(f"{line}\n" for line in lines))
        self._known[run.name.experiment] = runs

    def _read(self, experiment: str) -> dict[RunName, KeptRun]:
        path = self._path(experiment)
        try:
            lines = read_text(path, "it", MAX_BYTES).splitlines()
            kept = [_run(experiment, read_json(line, f"line {number}")) for number, line in enumerate(lines, 1)]
        except FileNotFoundError:
            return {}
        except (OSError, RledError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
            raise RledError(f"{path} holds something else than runs ({error})", "what reproduce writes") from None
        return {each.name: each for each in kept}

    def _path(self, experiment: str) -> Path:
        return self._folder / f"{experiment}.jsonl"


def _transposed(rows: list[dict[str, float]]) -> dict[str, Floats]:
    return {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else {})}


def _line(run: KeptRun) -> dict[str, Any]:
    tables = {
        stem: {
            name: [None if math.isnan(value) else value for value in column.tolist()] for name, column in each.items()
        }
        for stem, each in run.tables.items()
    }
    where = {"variant": run.name.variant, "seed": run.name.seed}
    return where | {"run": dict(run.record), "documents": dict(run.documents), "tables": tables}


def _run(experiment: str, line: dict[str, Any]) -> KeptRun:
    tables = {stem: _table(columns) for stem, columns in line["tables"].items()}
    name, documents = RunName(experiment, line["variant"], line["seed"]), line["documents"]
    if not (isinstance(name.variant, str) and type(name.seed) is int and isinstance(documents, dict)):
        raise ValueError(f"variant {name.variant}, seed {name.seed}")
    if not is_record(line["run"]):
        raise ValueError(f"no record of {name}")
    return KeptRun(name, line["run"], documents, tables)


def _table(columns: dict[str, Any]) -> dict[str, Floats]:
    table = {name: np.array(column, dtype=np.float64) for name, column in columns.items()}
    if len({each.shape for each in table.values()}) > 1 or any(each.ndim != 1 for each in table.values()):
        raise ValueError("columns of several lengths")
    return table
