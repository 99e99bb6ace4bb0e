"""What the person at the page wants the robot to do."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_teleop.jog import Jog
from rled_teleop.keys import LINEAR_SPEED

Vector = NDArray[np.float64]

THERE = 5e-4
"""Distance from a goal at which the tool counts as there (m)."""


class Follow(NamedTuple):
    """Take the tool to a point.

    Attributes:
        goal: (m), shape (3,).
    """

    goal: tuple[float, float, float]


class Move(NamedTuple):
    """Move the tool along a direction.

    Attributes:
        direction: of length 1, in the base frame, shape (3,).
    """

    direction: tuple[float, float, float]


class Turn(NamedTuple):
    """Take one joint to an angle.

    Attributes:
        joint: which.
        goal: (rad).
    """

    joint: int
    goal: float


Wish = Follow | Move | Turn


def delta(wish: Wish, jog: Jog, q: Vector, share: float) -> Vector:
    """The displacement of one tick that serves a wish.

    Args:
        wish: what the person wants.
        jog: the robot.
        q: joint angles (rad), shape (n,).
        share: of full speed, 0 to 1.

    Returns:
        Δq (rad), shape (n,).
    """
    if isinstance(wish, Turn):
        most = share * jog.task.max_delta
        return jog.joint(q, wish.joint, float(np.clip(wish.goal - q[wish.joint], -most, most)) / jog.task.max_delta)
    length = LINEAR_SPEED * share * jog.task.period * 1e-9
    if isinstance(wish, Move):
        return jog.cartesian(q, length * np.array(wish.direction), share)
    return jog.cartesian(q, _towards(np.array(wish.goal) - jog.chain.position(q), jog.task.axes, length), share)


def _towards(way: Vector, axes: tuple[int, ...], length: float) -> Vector:
    """A way (m) within the axes of the task, cut to a length; nothing when it is as good as there, shape (3,)."""
    step = np.zeros(3)
    step[list(axes)] = way[list(axes)]
    distance = float(np.linalg.norm(step))
    if distance < THERE:
        return np.zeros(3)
    return step * min(1.0, length / distance)
