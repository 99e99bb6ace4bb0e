"""The two phases of a demonstration (section 4.1.3): mark the points of ζᵃ, then join pairs of them."""

from collections.abc import Callable
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.tick import Tick
from rled_sim.kinematics import Chain, solve_position

from rled_teleop.operators.point_to_point import PointToPointMotion

Floats = NDArray[np.float64]
Steer = Callable[[Floats, Floats], PointToPointMotion]
"""Makes the motion from joint angles q to a goal (rad), both of shape (n,)."""


def joints_along(chain: Chain, curve: Floats, start: Floats, lower: Floats, upper: Floats) -> Floats:
    """Joint angles whose end effector follows a curve, neighbours of neighbours.

    Args:
        chain: kinematics of the robot, n joints.
        curve: positions (m), shape (k, 3).
        start: joint angles (rad) that the search for the first point begins at, shape (n,).
        lower: lower joint limits (rad), shape (n,).
        upper: upper joint limits (rad), shape (n,).

    Returns:
        Joint angles (rad), shape (k, n).

    Raises:
        RledError: a point is out of reach.
    """

    def follow(q: Floats, position: Floats) -> Floats:
        return solve_position(chain, position, q, lower, upper)

    return np.array(list(accumulate(curve, follow, initial=start))[1:])


class Marking:
    """Phase one: go along the goals and mark each on arrival.

    Args:
        goals: joint angles (rad) of the points to mark, shape (k, n).
        steer: makes the motions.

    Attributes:
        positions: end effector X_i (m) of the points marked so far.
        joints: joint angles q_i (rad) of the points marked so far.
    """

    def __init__(self, goals: Floats, steer: Steer) -> None:
        self._goals, self._steer = goals, steer
        self._motion: PointToPointMotion | None = None
        self.positions: list[Floats] = []
        self.joints: list[Floats] = []

    @property
    def finished(self) -> bool:
        """All points are marked."""
        return len(self.joints) == len(self._goals)

    def observe(self, tick: Tick, q: Floats) -> bool:
        """Take in a state; return whether it is to be marked."""
        if self.finished:
            return False
        self._motion = self._motion or self._steer(q, self._goals[len(self.joints)])
        if not self._motion.arrived(q):
            return False
        self.positions.append(tick.ee.position)
        self.joints.append(q)
        self._motion = None if self.finished else self._steer(q, self._goals[len(self.joints)])
        return True

    def step(self, q: Floats) -> Floats:
        """The next joint displacement (rad), shape (n,)."""
        assert self._motion is not None
        return self._motion.step(q)


class Joining:
    """Phase two: go from target to target, each by way of the point of ζᵃ nearest to it.

    Args:
        positions: X_i of ζᵃ (m), shape (k, 3).
        joints: q_i of ζᵃ (rad), shape (k, n).
        steer: makes the motions.

    Attributes:
        reached: targets reached since the phase began.
    """

    def __init__(self, positions: Floats, joints: Floats, steer: Steer) -> None:
        self._positions, self._joints, self._steer = positions, joints, steer
        self._motion: PointToPointMotion | None = None
        self._last: Tick | None = None
        self.reached = 0

    def observe(self, tick: Tick, q: Floats) -> None:
        """Take in a state: count a target that was reached, begin a motion when there is a new one."""
        if self._last is not None and self._last.status.episode == tick.status.episode:
            self.reached += tick.status.targets_reached > self._last.status.targets_reached  # one in a tick at most
        if self._is_new_target(tick):
            self._motion = self._steer(q, self.nearest(tick.target.position))
        self._last = tick

    def nearest(self, target: Floats) -> Floats:
        """Joint angles q_i (rad), shape (n,), of the point of ζᵃ nearest to a target (m), shape (3,)."""
        joints: Floats = self._joints[np.square(self._positions - target).sum(axis=1).argmin()]
        return joints

    def step(self, q: Floats) -> Floats:
        """The next joint displacement (rad), shape (n,)."""
        assert self._motion is not None
        self._motion.arrived(q)
        return self._motion.step(q)

    def _is_new_target(self, tick: Tick) -> bool:
        last = self._last
        if last is None or last.status.episode != tick.status.episode:
            return True
        return not np.array_equal(last.target.position, tick.target.position)
