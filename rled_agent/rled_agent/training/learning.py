"""The loop of a population of runs with its files: rows of metrics, checkpoints, policies, and a bar."""

import contextlib
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from threading import Event
from typing import NamedTuple

import numpy as np
from torch.utils.tensorboard import SummaryWriter

from rled_agent.training.metrics import MetricsAccumulator
from rled_agent.training.progress import Progress, summary
from rled_agent.training.run import Population
from rled_agent.training.run_directory import RunDirectory
from rled_agent.training.trainer import DivergenceError, Trainer


class _Begin(NamedTuple):
    """Where the runs were when this process took them up.

    Attributes:
        time: of the performance counter (s).
        step: environment steps.
        updates: gradient steps.
    """

    time: float
    step: int
    updates: int


def train(population: Population, directories: Sequence[RunDirectory], stop: Event) -> None:
    """Learn until the schedule's steps are done or ``stop`` is set; the last state is saved.

    A run whose loss is no number ends; the others go on.

    Args:
        population: the runs.
        directories: of each.
        stop: set it to end early.

    Raises:
        DivergenceError: the loss of a run is no number; told when all have ended.
    """
    loop = _Loop(population, directories)
    trainer, schedule = population.trainer, population.trainer.schedule
    with loop.opened(), Progress("step", schedule.steps, trainer.step) as progress:
        while trainer.step < schedule.steps and not stop.is_set() and loop.advance():
            progress.move(trainer.step)
            is_done = trainer.step == schedule.steps
            if trainer.step % schedule.log_every == 0 or is_done:
                rows = loop.log()
                progress.say(trainer.step, summary(rows, loop.names()))
            if trainer.step % schedule.checkpoint_every == 0 or is_done:
                loop.save()
    if stop.is_set():
        loop.save()
    loop.require_convergence()


class _Loop:
    """The runs that go on, and their files."""

    def __init__(self, population: Population, directories: Sequence[RunDirectory]) -> None:
        self._population, self._directories = population, directories
        self._trainer = population.trainer
        self._boards: list[SummaryWriter] = []
        self._begin = _Begin(time.perf_counter(), self._trainer.step, self._trainer.learning.learner.updates)
        self.alive = list(range(len(directories)))
        self._diverged: list[DivergenceError] = []

    def names(self) -> list[str]:
        """Of the runs that go on: their folders within that of all, as ``phi-0.1/seed-2``."""
        common = os.path.commonpath([each.path for each in self._directories])
        return [os.path.relpath(self._directories[k].path, common) for k in self.alive]

    @contextlib.contextmanager
    def opened(self) -> Iterator[None]:
        """Open the boards."""
        with contextlib.ExitStack() as stack:
            for each in self._directories:
                board = SummaryWriter(str(each.path), purge_step=self._trainer.step)
                self._boards.append(stack.enter_context(board))
            yield

    def advance(self) -> bool:
        """One step of all; whether a run goes on."""
        try:
            self._trainer.advance()
        except DivergenceError:  # of all that are left
            self._end_diverged()
        return bool(self.alive)

    def log(self) -> list[dict[str, float]]:
        """Close the interval of each run that goes on; evaluate when it is due."""
        self._end_diverged()
        rows = self._rows()
        for k in self.alive:
            directory = self._directories[k]
            directory.append(rows[k])
            if directory.ends_in_the_best():
                self._save_policy(k, directory.best_path)
            for name, value in rows[k].items():
                if np.isfinite(value):
                    self._boards[k].add_scalar(name, value, int(rows[k]["step"]))
        return [rows[k] for k in self.alive]

    def _rows(self) -> list[dict[str, float]]:
        trainer, begin = self._trainer, self._begin
        seconds, updates = time.perf_counter() - begin.time, trainer.learning.learner.updates
        common = {"updates": float(updates), "steps_per_second": (trainer.step - begin.step) / seconds}
        common["updates_per_second"] = (updates - begin.updates) / seconds
        rows = [{"step": float(trainer.step), **row, **common} for row in trainer.metrics.rows(trainer.has_expert)]
        trainer.metrics = MetricsAccumulator()
        if trainer.step % trainer.schedule.evaluate_every == 0:
            for row, found in zip(rows, trainer.evaluate(), strict=True):
                row |= {f"evaluation_{name}": value for name, value in found.items()}
        return rows

    def save(self) -> None:
        """Write checkpoint and policy of each run that goes on."""
        self._end_diverged()
        checkpoints = self._trainer.checkpoints()
        for k in self.alive:
            self._directories[k].save(checkpoints[k])
            self._save_policy(k, self._directories[k].policy_path)

    def _save_policy(self, run: int, path: Path) -> None:
        policy = self._population.policy(run)
        if policy is not None:
            policy.save(path)

    def _end_diverged(self) -> None:
        diverged = self._trainer.diverged.tolist()
        for k in [each for each in self.alive if diverged[each]]:
            self.alive.remove(k)
            self._diverged.append(_error(self._trainer, self._directories[k]))
            self._directories[k].write_diverged(self._trainer.step)

    def require_convergence(self) -> None:
        """Tell of runs that have ended early.

        Raises:
            DivergenceError: there are some.
        """
        if self._diverged:
            first, *others = self._diverged
            more = f"; and of {len(others)} more of {len(self._directories)} runs" if others else ""
            raise DivergenceError(f"{first.what}{more}", first.accepted, first.remedy)


def _error(trainer: Trainer, directory: RunDirectory) -> DivergenceError:
    last = f"the last good checkpoint is {directory.checkpoint_path}"
    kept = last if directory.checkpoint_path.exists() else "there is no checkpoint yet"
    what = f"a loss is no number at step {trainer.step} in {directory.path}"
    return DivergenceError(what, "", f"lower the learning rates; {kept}")
