"""Runs that one process makes together: the seeds of a variant, as a population."""

from collections.abc import Iterable, Mapping
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from rled_agent.experiments.experiment import OTHER_RUN, Run, RunName

POPULATES = "train_agent"
"""The program that makes several runs at once."""


class Job(NamedTuple):
    """Runs of one variant that differ in their seeds.

    Attributes:
        runs: one or more.
        device: that they are made on; of programs that know of one.
    """

    runs: tuple[Run, ...]
    device: str = "cpu"

    @property
    def needs(self) -> tuple[RunName, ...]:
        """Runs whose files the command reads."""
        return tuple(dict.fromkeys(need for run in self.runs for need in run.needs))

    def __str__(self) -> str:
        first = self.runs[0].name
        others = f" and {len(self.runs) - 1} more" if len(self.runs) > 1 else ""
        return f"{first}{others}"

    def arguments(self, root: Path) -> list[str]:
        """Program and options with all folders filled in, those of runs below ``root``."""
        first = self.runs[0]
        device = ["--device", self.device] if first.command[0] == POPULATES and self.device != "cpu" else []
        if len(self.runs) == 1:
            return first.arguments(root) + device
        command = first.command[: -len(("--seed", "0"))]
        filled = [
            OTHER_RUN.sub(lambda found: str(root / found[1] / found[2] / "seed-{seed}"), part) for part in command
        ]
        seeds = ",".join(str(run.name.seed) for run in self.runs)
        return [*filled, "--seeds", seeds, "--output", str((root / first.name.folder).parent), *device]


def jobs_of(runs: Mapping[RunName, Run], at_once: int, device: str = "cpu") -> list[Job]:
    """Jobs that make all runs, the seeds of a variant together, but no fewer jobs than can be made at once.

    Args:
        runs: to be made, by name.
        at_once: jobs made at a time.
        device: that they are made on.
    """
    most = max(1, -(-len(runs) // at_once))
    ordered = sorted(runs.values(), key=lambda run: (_variant(run), run.name.seed))
    found: list[Job] = []
    for _, group in groupby(ordered, key=_variant):
        together = [*group]
        size = most if together[0].command[0] == POPULATES else 1
        found += [Job(tuple(together[k : k + size]), device) for k in range(0, len(together), size)]
    return found


def by_run(jobs: Iterable[Job]) -> dict[RunName, Job]:
    """The job that makes each run."""
    return {run.name: job for job in jobs for run in job.runs}


def _variant(run: Run) -> tuple[str, str]:
    return run.name.experiment, run.name.variant
