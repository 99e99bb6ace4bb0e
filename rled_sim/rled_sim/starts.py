"""Joint angles that episodes start at: the operator's demonstration points ζᵃ."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.topics import MARKED_JOINT_STATES


def start_points(joints: ArrayLike, task: TaskDescription) -> list[list[float]]:
    """Check joint angles (rad), shape (k, n), and return them as rows.

    Raises:
        RledError: another shape, or angles outside the joint limits.
    """
    points = np.asarray(joints, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != task.action_size or not len(points):
        raise RledError(f"start joints of shape {points.shape}", f"(k, {task.action_size}), k at least 1")
    inside = (points >= task.joint_lower) & (points <= task.joint_upper)
    if not inside.all():
        row, joint = np.argwhere(~inside)[0]
        limits = f"{task.joint_lower[joint]} to {task.joint_upper[joint]} rad"
        raise RledError(f"start joints {row}: {task.joint_names[joint]} is {points[row, joint]}", limits)
    rows: list[list[float]] = points.tolist()
    return rows


def marked_joints(bag: Path, task: TaskDescription) -> NDArray[np.float64]:
    """The joint angles marked in a demonstration bag (rad), shape (k, n).

    Raises:
        RledError: no such bag, a bag of another robot, or one without marked points.
    """
    from rled_msgs_py.bags import Bag  # slow to load, and seldom asked for

    demonstration = Bag(bag)
    task.require_same_robot(demonstration.task, f"bag {bag}")
    table = demonstration.joints(MARKED_JOINT_STATES)
    joints: NDArray[np.float64] = table.ordered(task.joint_names).position if len(table.position) else table.position
    if not len(joints):
        raise RledError(f"bag {bag} has no marked points", "a bag recorded with them", "record one with record_demos")
    return joints
