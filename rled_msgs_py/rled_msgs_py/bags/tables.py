"""Joint and pose messages of one topic as arrays."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.columns import Columns, Floats, Kind, Part, Stamps, by_labels, order_of, parts_of
from rled_msgs_py.bags.layout import Layout
from rled_msgs_py.bags.storage import Messages
from rled_msgs_py.joint_names import find_by_name
from rled_msgs_py.records import UNIT_TOLERANCE, DeltaCommand, JointSample, Record
from rled_msgs_py.topics import Topic
from rled_msgs_py.vectors import rates_of


class JointTable(NamedTuple):
    """Joint messages of one topic, k of them, in log order.

    Attributes:
        stamps: simulation time (ns), shape (k,).
        names: joint names of all messages, n of them, in the order of their first appearance; none when k is 0.
        position: joint angles, or displacements Δq on ``joint_delta`` (rad), shape (k, n); NaN where a message does not
            know or does not name a joint.
        velocity: joint rates (rad/s), shape (k, n); zeros where the messages have none, NaN where they are not known.
        named: whether a message names a joint, shape (k, n).
    """

    stamps: Stamps
    names: tuple[str, ...]
    position: Floats
    velocity: Floats
    named: NDArray[np.bool_]

    def ordered(self, names: tuple[str, ...]) -> "JointTable":
        """The joints ``names``, in their order, of the messages that have a finite position of each of them.

        Raises:
            ContractError: no message names one of them.
        """
        order = find_by_name(self.names, names, "a bag")
        position, named = self.position[:, order], self.named[:, order]
        whole = np.isfinite(position).all(axis=1)
        return JointTable(self.stamps[whole], names, position[whole], self.velocity[:, order][whole], named[whole])


class PoseTable(NamedTuple):
    """Pose messages of one topic, k of them, in log order.

    Attributes:
        stamps: simulation time (ns), shape (k,).
        frame: frame that all poses are expressed in; empty when k is 0.
        position: origins (m), shape (k, 3).
        orientation: unit quaternions (x, y, z, w), shape (k, 4).
    """

    stamps: Stamps
    frame: str
    position: Floats
    orientation: Floats


def joint_table(topic: Topic, runs: Iterable[Messages]) -> JointTable:
    """Joint messages as arrays.

    Raises:
        ContractError: a message is not valid.
    """
    return _joint_table(parts_of(_JOINTS, topic, runs))


def joint_table_of(records: Sequence[JointSample | DeltaCommand]) -> JointTable:
    """Records as arrays, in their order."""
    return _joint_table(by_labels(np.arange(len(records)), np.arange(len(records)), map(_joint_row, records)))


def pose_table(topic: Topic, runs: Iterable[Messages]) -> PoseTable:
    """Pose messages as arrays.

    Raises:
        ContractError: a message is not valid, or is in another frame than the first.
    """
    parts = parts_of(_POSES, topic, runs)
    if not parts:
        return PoseTable(np.empty(0, np.int64), "", np.empty((0, 3)), np.empty((0, 4)))
    order = order_of(parts)
    stamps, position, orientation = (
        np.concatenate([each.columns[column] for each in parts])[order] for column in (0, 2, 3)
    )
    return PoseTable(stamps, parts[0].columns.labels[0], position, orientation)


def _joint_table(parts: list[Part]) -> JointTable:
    if not parts:
        empty = np.empty((0, 0))
        return JointTable(np.empty(0, np.int64), (), empty, empty, empty.astype(bool))
    names = tuple(dict.fromkeys(name for part in parts for name in part.columns.labels))
    order = order_of(parts)
    stamps = np.concatenate([part.columns.stamps for part in parts])[order]
    if all(part.columns.labels == names for part in parts):
        position, velocity = (np.concatenate([part.columns[side] for part in parts])[order] for side in (2, 3))
        return JointTable(stamps, names, position, velocity, np.ones(position.shape, dtype=bool))
    position, velocity, named = (np.full((len(stamps), len(names)), value) for value in (np.nan, np.nan, False))
    begin = 0
    for part in parts:
        rows = slice(begin, begin + len(part.places))
        columns = [names.index(name) for name in part.columns.labels]
        position[rows, columns], velocity[rows, columns] = part.columns.left, part.columns.right
        named[rows, columns] = True
        begin = rows.stop
    return JointTable(stamps, names, position[order], velocity[order], named[order])


def _joint_row(record: Any) -> Columns:
    if isinstance(record, DeltaCommand):
        return Columns(record.stamp, record.names, record.delta, np.zeros(len(record.names)))
    return Columns(record.stamp, record.names, record.position, record.velocity)


def _place_joints(layout: Layout, n: int) -> None:
    layout.count("names")
    for joint in range(n):
        layout.text(f"name {joint}")
    for field in ("position", "velocity", "effort"):
        layout.doubles(field, layout.count(field))


def _look_at_joints(rows: NDArray[np.void], first: Record) -> tuple[Floats, Floats] | None:
    position = rows["position"].astype(np.float64)
    if isinstance(first, DeltaCommand):
        return (position, np.zeros_like(position)) if np.isfinite(position).all() else None
    velocity = rows["velocity"] if "velocity" in (rows.dtype.names or ()) else np.empty((len(rows), 0))
    return position, rates_of(velocity.astype(np.float64), position.shape[1])


def _pose_row(record: Any) -> Columns:
    return Columns(record.stamp, (record.frame,), record.position, record.orientation)


def _place_pose(layout: Layout, _: int) -> None:
    layout.doubles("position", 3)
    layout.doubles("orientation", 4)


def _look_at_poses(rows: NDArray[np.void], _: Record) -> tuple[Floats, Floats] | None:
    position, orientation = rows["position"].astype(np.float64), rows["orientation"].astype(np.float64)
    with np.errstate(over="ignore"):
        unit = np.abs((orientation**2).sum(axis=1) - 1.0) <= UNIT_TOLERANCE
    return (position, orientation) if np.isfinite(position).all() and unit.all() else None


_JOINTS = Kind(None, _joint_row, _place_joints, _look_at_joints)
_POSES = Kind("frame", _pose_row, _place_pose, _look_at_poses)
