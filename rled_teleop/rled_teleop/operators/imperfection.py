"""What tells a human hand from a machine: tremor, pauses, overshoot."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.task import TaskDescription

Vector = NDArray[np.float64]

TREMOR_STDS = 3.0
"""Multiples of the std of tremor within which a shaking hand counts as arrived."""


@dataclass(frozen=True)
class Imperfection:
    """How far an operator is from perfect; a perfect one by default.

    Attributes:
        tremor: std of Gaussian noise on every joint displacement, as a share of Δq_max (1).
        pause_probability: chance that a pause begins at a step (1).
        pause_steps: mean length of a pause, geometrically distributed (steps).
        overshoot: how far a motion goes past its goal before it comes back, as a share of its length (1).
    """

    tremor: float = 0.0
    pause_probability: float = 0.0
    pause_steps: float = 10.0
    overshoot: float = 0.0


class Hand:
    """An operator's hand: turns intended motions into those that a person makes.

    Args:
        imperfection: how imperfect it is.
        task: robot with Δq_max and joint limits.
        generator: source of tremor and pauses; a perfect hand draws nothing from it.
    """

    def __init__(self, imperfection: Imperfection, task: TaskDescription, generator: np.random.Generator) -> None:
        self._imperfection, self._task, self._generator = imperfection, task, generator
        self._pause = 0

    def waypoints(self, start: Vector, goal: Vector) -> list[Vector]:
        """Joint angles (rad), each of shape (n,), that the hand steers to in turn; the last one is the goal."""
        overshoot = self._imperfection.overshoot
        if not overshoot:
            return [goal]
        beyond = goal + overshoot * (goal - start)
        return [np.clip(beyond, self._task.joint_lower, self._task.joint_upper), goal]

    def move(self, intended: Vector) -> Vector:
        """The joint displacement that comes of an intended one (rad), shape (n,); within Δq_max."""
        if self._pauses():
            return np.zeros_like(intended)
        if not self._imperfection.tremor:
            return intended
        limit = self._task.max_delta
        noise = self._generator.normal(0.0, self._imperfection.tremor * limit, intended.shape)
        return np.clip(intended + noise, -limit, limit)

    def arrived_within(self, tolerance: float) -> float:
        """Widen a tolerance (rad) to what a trembling hand can hold."""
        return max(tolerance, TREMOR_STDS * self._imperfection.tremor * self._task.max_delta)

    def _pauses(self) -> bool:
        if self._pause:
            self._pause -= 1
        elif self._generator_says_pause():
            self._pause = int(self._generator.geometric(1.0 / self._imperfection.pause_steps))
        return self._pause > 0

    def _generator_says_pause(self) -> bool:
        chance = self._imperfection.pause_probability
        return chance > 0 and self._generator.random() < chance
