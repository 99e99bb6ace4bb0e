"""From the page's order to the displacement of one tick."""

import numpy as np
from numpy.typing import NDArray

from rled_teleop.operators.jog import Jog
from rled_teleop.operators.keys import LINEAR_SPEED
from rled_teleop.web.jog_command import Move, Turn, Wish
from rled_teleop.web.set_point import Order

Vector = NDArray[np.float64]

THERE = 5e-4
"""Distance from a goal at which the tool counts as there (m)."""


def steer(order: Order, jog: Jog, q: Vector, now: float) -> Vector | None:
    """What an order makes of one tick.

    Args:
        order: the page's newest.
        jog: the robot.
        q: joint angles (rad), shape (n,).
        now: time (s of the monotonic clock).

    Returns:
        Δq (rad), shape (n,); None when nobody wants anything at that time.
    """
    if order.wish is None or not order.is_wished(now):
        return np.zeros(len(q)) if order.taken else None
    return delta(order.wish, jog, q, order.share)


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
