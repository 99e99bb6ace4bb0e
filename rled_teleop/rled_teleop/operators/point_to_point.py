"""One motion of the operator in joint space, from where the robot is to a goal."""

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError

from rled_teleop.operators.demonstration import demonstrated_action
from rled_teleop.operators.imperfection import Hand

Vector = NDArray[np.float64]

MAX_IDLE_STEPS = 1500
"""Steps without coming nearer after which a motion is given up: half a minute at 20 ms a step."""


class PointToPointMotion:
    """Steers to a goal by the demonstrated action, with one hand.

    Args:
        start: joint angles (rad) at its beginning, shape (n,).
        goal: joint angles (rad) to reach, shape (n,).
        hand: who steers.
        max_delta: Δq_max (rad).
        tolerance: largest joint error (rad) that counts as arrived.
    """

    def __init__(self, start: Vector, goal: Vector, hand: Hand, max_delta: float, tolerance: float) -> None:
        self._waypoints = hand.waypoints(start, goal)
        self._hand, self._max_delta = hand, max_delta
        self._tolerance = hand.arrived_within(tolerance)
        self._nearest, self._idle = np.inf, 0

    def arrived(self, q: Vector) -> bool:
        """Whether the goal is reached at joint angles ``q``; a waypoint before it is dropped when reached.

        Raises:
            RledError: the robot has not come nearer for a long while.
        """
        distance = self._distance(q)
        if distance <= self._tolerance and len(self._waypoints) > 1:
            del self._waypoints[0]
            self._nearest, distance = np.inf, self._distance(q)
        self._watch(distance)
        return len(self._waypoints) == 1 and distance <= self._tolerance

    def step(self, q: Vector) -> Vector:
        """The next joint displacement (rad), shape (n,)."""
        return self._hand.move(demonstrated_action(q, self._waypoints[0], self._max_delta))

    def _distance(self, q: Vector) -> float:
        return float(np.abs(self._waypoints[0] - q).max())

    def _watch(self, distance: float) -> None:
        self._idle = 0 if distance < self._nearest else self._idle + 1
        self._nearest = min(self._nearest, distance)
        if self._idle > MAX_IDLE_STEPS:
            raise RledError(
                f"the robot stays {self._nearest:.2g} rad from its goal",
                f"an error of {self._tolerance:.2g} rad",
                "raise joint_tolerance, or release a pause or an emergency stop",
            )
