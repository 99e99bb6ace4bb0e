"""From the page's set point to the displacement of one tick."""

import numpy as np
from numpy.typing import NDArray

from rled_teleop.operators.jog import Jog
from rled_teleop.operators.keys import LINEAR_SPEED
from rled_teleop.web.jog_command import JogCommand, Move, Turn
from rled_teleop.web.set_point import SetPoint

Vector = NDArray[np.float64]

THERE = 5e-4
"""Distance from a goal at which the tool counts as there (m)."""


def steer(set_point: SetPoint, jog: Jog, q: Vector, now: float) -> Vector | None:
    """What a set point makes of one tick.

    Args:
        set_point: the page's newest.
        jog: the robot.
        q: joint angles (rad), shape (n,).
        now: time (s of the monotonic clock).

    Returns:
        Δq (rad), shape (n,); None when nobody wants anything at that time.
    """
    if set_point.command is None or not set_point.is_commanded(now):
        return np.zeros(len(q)) if set_point.taken else None
    return delta(set_point.command, jog, q, set_point.share)


def delta(command: JogCommand, jog: Jog, q: Vector, share: float) -> Vector:
    """The displacement of one tick that serves a command.

    Args:
        command: what the person wants.
        jog: the robot.
        q: joint angles (rad), shape (n,).
        share: of full speed, 0 to 1.

    Returns:
        Δq (rad), shape (n,).
    """
    if isinstance(command, Turn):
        limit = share * jog.task.max_delta
        return jog.joint(
            q, command.joint, float(np.clip(command.goal - q[command.joint], -limit, limit)) / jog.task.max_delta
        )
    length = LINEAR_SPEED * share * jog.task.period * 1e-9
    if isinstance(command, Move):
        return jog.cartesian(q, length * np.array(command.direction), share)
    return jog.cartesian(q, _towards(np.array(command.goal) - jog.chain.position(q), jog.task.axes, length), share)


def _towards(offset: Vector, axes: tuple[int, ...], length: float) -> Vector:
    """An offset (m) within the axes of the task, cut to a length; nothing when it is as good as there, shape (3,)."""
    step = np.zeros(3)
    step[list(axes)] = offset[list(axes)]
    distance = float(np.linalg.norm(step))
    if distance < THERE:
        return np.zeros(3)
    return step * min(1.0, length / distance)
