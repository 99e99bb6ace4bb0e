"""How far one episode of a task has come, and when it ends."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rled_sim.plant import Point
from rled_sim.tasks import ReachTask


class Outcome(NamedTuple):
    """What the task says of one transition."""

    reward: float
    terminated: bool
    truncated: bool


class Episode:
    """The counters of one episode.

    Attributes:
        target: point to reach (m).
        steps: transitions so far.
        targets_reached: targets reached.
        risky: the present state is risky.
        violations: risky states so far, the first state included.
        outcome: of the last transition.
    """

    def __init__(self, task: ReachTask, q: Sequence[float], position: Point, target: Point) -> None:
        self._task = task
        self.target = target
        self.steps = self.targets_reached = 0
        self.risky: bool = task.risky(q, position)
        self.violations = int(self.risky)
        self.outcome = Outcome(0.0, False, False)

    @property
    def over(self) -> bool:
        """No transition may follow."""
        return self.outcome.terminated or self.outcome.truncated

    def advance(self, q: Sequence[float], position: Point, rng: np.random.Generator) -> Outcome:
        """Count a transition to joint angles ``q`` (rad) and tip ``position`` (m).

        A reached target becomes the start, and a new one is drawn unless it was the last, which terminates the episode.
        The step limit truncates it: the state that it ends in has a value, and so a target.
        """
        task, limits = self._task, self._task.description
        reward, reached, self.risky = task.judge_columns(q, position, self.target)
        self.steps += 1
        self.violations += self.risky
        self.targets_reached += reached
        terminated = reached and self.targets_reached == limits.targets_per_episode
        truncated = not terminated and self.steps == limits.max_steps
        if reached and not terminated:
            self.target = task.draw_target(rng)
        self.outcome = Outcome(reward, terminated, truncated)
        return self.outcome
