"""An experiment as a file: the commands that make its runs, for each variant and seed, and what is drawn of them."""

import re
import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.untrusted import read_text
from rled_msgs_py.validation import check_fields

P = TypeVar("P")
Verdict = Literal["reproduced", "partly", "not", "answered", "open"]
"""Of a claim; ``answered`` is for a question, ``open`` for what has too few runs yet."""
Kind = Literal["curves", "cloning", "bins", "paths", "tradeoff", "episodes"]
COMMANDS = ("train_expert", "train_agent", "train_baseline", "evaluate_agent")
OTHER_RUN = re.compile(r"\{([^{}/]+)/([^{}/]+)\}")


class ExperimentError(RledError):
    """An experiment file that says what can't be done."""


class RunName(NamedTuple):
    """Which run: also its folder.

    Attributes:
        experiment: name of the file.
        variant: what is different in it.
        seed: of everything drawn.
    """

    experiment: str
    variant: str
    seed: int

    @property
    def folder(self) -> Path:
        """Relative to the folder of all runs."""
        return Path(self.experiment, self.variant, f"seed-{self.seed}")

    def __str__(self) -> str:
        return str(self.folder)


@dataclass(frozen=True)
class Run:
    """One command and what it needs.

    Attributes:
        name: which run.
        command: program and options, without the output folder; other runs' folders as ``{experiment/variant}``.
    """

    name: RunName
    command: tuple[str, ...]

    @property
    def needs(self) -> tuple[RunName, ...]:
        """Runs, of the same seed, whose files the command reads."""
        found = [
            RunName(each[1], each[2], self.name.seed) for part in self.command for each in OTHER_RUN.finditer(part)
        ]
        return tuple(dict.fromkeys(found))

    def arguments(self, root: Path) -> list[str]:
        """The command with all folders filled in, those of runs below ``root``."""

        def folder(found: re.Match[str]) -> str:
            return str(root / RunName(found[1], found[2], self.name.seed).folder)

        return [OTHER_RUN.sub(folder, part) for part in self.command] + ["--output", str(root / self.name.folder)]


@dataclass(frozen=True)
class Variant:
    """What one group of runs has of its own.

    Attributes:
        label: in pictures and tables.
        options: put behind the command.
        command: in place of the experiment's.
    """

    label: str
    options: list[str] = field(default_factory=list)
    command: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Drawing:
    """One picture.

    Attributes:
        kind: how it is drawn.
        metric: column of ``metrics.csv`` for curves and trade-offs, metric of an episode, distance bin for paths.
        label: what that is, with its unit.
        log: logarithmic axis.
        ordered: the variants are steps of one scale, and so are their colours.
        level: of the metric, whose first step is told.
        window: rows of ``metrics.csv`` whose mean is drawn and counted with.
        cloning: name by which the cloned expert of the first variant stands beside curves of an evaluation.
    """

    kind: Kind
    metric: str = ""
    label: str = ""
    log: bool = False
    ordered: bool = False
    level: float | None = None
    window: int = 1
    cloning: str = ""


@dataclass(frozen=True)
class Experiment:
    """A file of ``docs/results/experiments``.

    Attributes:
        name: of the file; a figure of the thesis has its number.
        title: one line.
        claim: what the thesis says, or what is asked.
        settings: which preset, and what was changed.
        command: of every run; its seed is put behind it.
        seeds: number of seeds, from 0.
        variants: by name.
        runs_of: another experiment whose runs are looked at here; then there is neither command nor seeds.
        drawings: pictures.
        verdict: whether the claim is reproduced, or the question answered.
        reason: why that is the verdict.
    """

    name: str
    title: str
    claim: str
    settings: str = ""
    command: list[str] = field(default_factory=list)
    seeds: int = 0
    variants: dict[str, Variant] = field(default_factory=dict)
    runs_of: str = ""
    drawings: list[Drawing] = field(default_factory=list)
    verdict: Verdict = "open"
    reason: str = ""

    def runs(self) -> list[Run]:
        """All runs, seed by seed, so that a part of them already compares the variants."""
        names = [RunName(self.name, variant, seed) for seed in range(self.seeds) for variant in self.variants]
        return [Run(name, self._command(name)) for name in names]

    def _command(self, name: RunName) -> tuple[str, ...]:
        variant = self.variants[name.variant]
        return *(variant.command or self.command), *variant.options, "--seed", str(name.seed)


def read_experiment(path: Path) -> Experiment:
    """Read one file.

    Raises:
        ExperimentError: what is wrong with it.
    """
    try:
        values = tomllib.loads(read_text(path, "it"))
    except (OSError, RecursionError, ContractError, tomllib.TOMLDecodeError) as error:
        raise ExperimentError(f"{path}: {error}", "a TOML file") from None
    variants = {name: _record(Variant, each, path) for name, each in _part(values, "variants", dict, path).items()}
    drawings = [_record(Drawing, each, path) for each in _part(values, "drawings", list, path)]
    experiment: Experiment = _record(
        Experiment, values | {"name": path.stem, "variants": variants, "drawings": drawings}, path
    )
    _require(experiment, path)
    return experiment


def _part(values: dict[str, Any], name: str, kind: type[P], path: Path) -> P:
    part = values.pop(name, kind())
    if not isinstance(part, kind):
        raise ExperimentError(f"{path}: {name} is {str(part)[:80]}", "tables")
    return part


def _record(kind: type[Any], values: Any, path: Path) -> Any:
    known = [each.name for each in fields(kind)]
    if not isinstance(values, dict) or (unknown := [name for name in values if name not in known]):
        what = ", ".join(unknown) if isinstance(values, dict) else str(values)[:80]
        raise ExperimentError(f"{path}: {what} in {kind.__name__.lower()}", ", ".join(known))
    try:
        record = kind(**values)
        check_fields(record)
    except (TypeError, ContractError) as error:
        raise ExperimentError(f"{path}: {error}", ", ".join(known)) from None
    return record


def _require(experiment: Experiment, path: Path) -> None:
    if experiment.runs_of:
        return
    for command in (each.command or experiment.command for each in experiment.variants.values()):
        if not command or command[0] not in COMMANDS:
            raise ExperimentError(f"{path}: command {command[:1]}", ", ".join(COMMANDS))
    if experiment.seeds < 1 or not experiment.variants:
        raise ExperimentError(f"{path}: no runs", "seeds of 1 or more, and variants")


class Library:
    """All experiment files of a folder.

    Args:
        folder: where they are.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> list[str]:
        """Of all files, figures of the thesis first and in their order.

        Raises:
            ExperimentError: there is none.
        """
        found = sorted((path.stem for path in self._folder.glob("*.toml")), key=_order)
        if not found:
            raise ExperimentError(f"there are no experiments in {self._folder}", "", "run it in the project's folder")
        return found

    def read(self, name: str) -> Experiment:
        """One experiment.

        Raises:
            ExperimentError: there is none of that name.
        """
        if name not in self.names():
            raise ExperimentError(f"no experiment '{name}' in {self._folder}", ", ".join(self.names()))
        return read_experiment(self._folder / f"{name}.toml")

    def with_needs(self, names: list[str]) -> dict[RunName, Run]:
        """Runs of the experiments named and all runs that these need, by name.

        Raises:
            ExperimentError: a run needs another that no file makes.
        """
        found: dict[RunName, Run] = {}
        waiting = [run for name in names for run in self._runs(name)]
        while waiting:
            run = waiting.pop(0)
            if run.name not in found:
                found[run.name] = run
                waiting += [self._run(need, run.name) for need in run.needs]
        return found

    def _runs(self, name: str) -> list[Run]:
        experiment = self.read(name)
        return self._runs(experiment.runs_of) if experiment.runs_of else experiment.runs()

    def _run(self, name: RunName, by: RunName) -> Run:
        for run in self._runs(name.experiment):
            if run.name == name:
                return run
        raise ExperimentError(f"{by} needs {name}, which no experiment makes", "a variant and seed of its file")


def _order(name: str) -> tuple[bool, list[int], str]:
    numbers = [int(part) for part in re.findall(r"\d+", name)] if name[0].isdigit() else []
    return not numbers, numbers, name
