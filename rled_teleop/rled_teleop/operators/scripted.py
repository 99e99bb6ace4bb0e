"""The scripted operator of section 4.1.3, as a state machine from ticks to answers."""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import DeltaCommand
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_sim.kinematics import Chain

from rled_teleop.operators.imperfection import Hand
from rled_teleop.operators.phases import Joining, Marking, joints_along
from rled_teleop.operators.point_to_point import PointToPointMotion

Floats = NDArray[np.float64]


class Answer(NamedTuple):
    """What the operator does at a tick.

    Attributes:
        delta: displacement to ask for, None when there is nothing to answer: a task just ended, or all is done.
        mark: the state of this tick is a point of ζᵃ.
    """

    delta: DeltaCommand | None
    mark: bool


class ScriptedOperator:
    """Marks the points of a curve, then joins them from target to target.

    Args:
        task: robot and task.
        chain: the robot's kinematics.
        curve: end-effector positions (m) to mark, shape (k, 3).
        trajectories: targets to reach after that.
        hand: who steers.
        joint_tolerance: largest joint error (rad) at which a point counts as arrived at.
    """

    def __init__(
        self,
        task: TaskDescription,
        chain: Chain,
        curve: Floats,
        trajectories: int,
        hand: Hand,
        joint_tolerance: float = 1e-6,
    ) -> None:
        self._task, self._chain, self._curve = task, chain, curve
        self._trajectories = trajectories
        self._steer = partial(PointToPointMotion, hand=hand, max_delta=task.max_delta, tolerance=joint_tolerance)
        self._marking: Marking | None = None
        self._joining: Joining | None = None

    @property
    def points(self) -> int:
        """Points of ζᵃ to mark."""
        return len(self._curve)

    @property
    def points_marked(self) -> int:
        """Points of ζᵃ marked so far."""
        return len(self._marking.joints) if self._marking else 0

    @property
    def targets_reached(self) -> int:
        """Trajectories of ζᵇ demonstrated so far."""
        return self._joining.reached if self._joining else 0

    @property
    def finished(self) -> bool:
        """Everything asked for is demonstrated."""
        return self._joining is not None and self._joining.reached >= self._trajectories

    def answer(self, tick: Tick) -> Answer:
        """Decide on one state.

        Raises:
            RledError: a point of the curve is out of reach, or the robot does not move as asked.
        """
        q = tick.joints.ordered(self._task.joint_names).position
        self._marking = self._marking or self._plan(q)
        mark = self._marking.observe(tick, q)
        if self._marking.finished:
            self._joining = self._joining or self._join(self._marking)
            self._joining.observe(tick, q)
        if self.finished or tick.status.terminated or tick.status.truncated:
            return Answer(None, mark)
        step = (self._joining or self._marking).step(q)
        return Answer(DeltaCommand(tick.stamp, self._task.joint_names, step), mark)

    def _plan(self, q: Floats) -> Marking:
        lower, upper = np.array(self._task.joint_lower), np.array(self._task.joint_upper)
        return Marking(joints_along(self._chain, self._curve, q, lower, upper), self._steer)

    def _join(self, marking: Marking) -> Joining:
        return Joining(np.array(marking.positions), np.array(marking.joints), self._steer)


def spread(targets: Floats, count: int) -> Floats:
    """``count`` of the points of a curve, evenly spread: (k, 3) -> (count, 3).

    Raises:
        RledError: there are not that many.
    """
    if count > len(targets):
        raise RledError(f"{count} points of the target curve", f"1 to {len(targets)}", "mark fewer points")
    chosen: Floats = targets[np.arange(count) * len(targets) // count]
    return chosen


def require_reachable(task: TaskDescription, curve: Floats, targets: Floats) -> None:
    """Refuse points so far apart that the one nearest to a target is not close enough to count as reached.

    Args:
        task: task with ε_x.
        curve: positions to be marked (m), shape (k, 3).
        targets: targets that the task draws from (m), shape (t, 3).

    Raises:
        RledError: names the worst distance and the one allowed.
    """
    worst = max(float(np.square(curve - target).sum(axis=1).min()) for target in targets)
    if worst >= task.tolerance:
        raise RledError(
            f"a target is {worst**0.5:.3f} m from the nearest of {len(curve)} points",
            f"less than {task.tolerance**0.5:.3f} m",
            "mark more points",
        )
