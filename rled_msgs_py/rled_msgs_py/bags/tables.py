"""Many messages of one topic as arrays.

The messages of one robot have the same names, so the same length and the same places for their numbers. The layout is
worked out once, from the first message, and all messages are looked at through it in a few array operations. Where one
does not fit (another length, other names, a NaN) they are read one by one, which accepts it or names the offender.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.layout import Layout, stamps_of, view
from rled_msgs_py.bags.storage import Messages
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import decode
from rled_msgs_py.records import UNIT_TOLERANCE, DeltaCommand, Record, order_by_name
from rled_msgs_py.topics import Topic

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]


class JointTable(NamedTuple):
    """Joint messages of one topic, k of them, in log order.

    Attributes:
        stamps: simulation time (ns), shape (k,).
        names: joint names, n of them; none when k is 0.
        position: joint angles, or displacements Δq on ``joint_delta`` (rad), shape (k, n).
        velocity: joint rates (rad/s), shape (k, n); zeros where the messages have none.
    """

    stamps: Stamps
    names: tuple[str, ...]
    position: Floats
    velocity: Floats

    def ordered(self, names: tuple[str, ...]) -> "JointTable":
        """The same table with its joints in the order of ``names``.

        Raises:
            ContractError: a wanted name is missing or an unknown one is there.
        """
        order = order_by_name(self.names, names, "a bag")
        return JointTable(self.stamps, names, self.position[:, order], self.velocity[:, order])


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


class _Columns(NamedTuple):
    """What both tables are made of: one row of a message, or the rows of many."""

    stamps: Any
    labels: tuple[str, ...]
    left: Floats
    right: Floats


class _Kind(NamedTuple):
    """How one kind of message becomes columns.

    Attributes:
        labels: what the labels are, for an error.
        of: the row of a record.
        place: adds the fields after the header to a layout, for n labels.
        look: both number columns of messages seen through that layout, or None where one is not valid.
    """

    labels: str
    of: Callable[[Any], _Columns]
    place: Callable[[Layout, int], None]
    look: Callable[[NDArray[np.void], Record], tuple[Floats, Floats] | None]


def joint_table(topic: Topic, runs: Iterable[Messages]) -> JointTable:
    """Joint messages as arrays.

    Raises:
        ContractError: a message is not valid, or names other joints than the first.
    """
    columns = _columns(_JOINTS, topic, runs)
    return JointTable(*columns) if columns else JointTable(*_no_rows((), 0, 0))


def pose_table(topic: Topic, runs: Iterable[Messages]) -> PoseTable:
    """Pose messages as arrays.

    Raises:
        ContractError: a message is not valid, or is in another frame than the first.
    """
    columns = _columns(_POSES, topic, runs) or _no_rows(("",), 3, 4)
    return PoseTable(columns.stamps, columns.labels[0], columns.left, columns.right)


def payloads(run: Messages) -> Iterator[bytes]:
    """The serialized messages of a run."""
    for start, size in zip(run.start.tolist(), run.size.tolist(), strict=True):
        yield run.data[start : start + size]


def read_record(topic: Topic, number: int, data: bytes) -> Record:
    """Decode a message.

    Raises:
        ContractError: names the message.
    """
    try:
        return decode(topic, data)
    except ContractError as error:
        raise ContractError(f"message {number} of {topic.name}: {error.what}", error.accepted, error.remedy) from None


def _columns(kind: _Kind, topic: Topic, runs: Iterable[Messages]) -> _Columns | None:
    parts, times, number = list[_Columns](), list[Stamps](), 0
    for run in runs:
        if not len(run.size):
            continue
        first = read_record(topic, number, next(payloads(run)))
        labels = parts[0].labels if parts else kind.of(first).labels
        part = _looked_at(kind, run, first)
        if part is None or part.labels != labels:
            part = _read(kind, topic, run, number, labels)
        parts.append(part)
        times.append(run.log_time)
        number += len(run.size)
    if not parts:
        return None
    order = np.argsort(np.concatenate(times), kind="stable")
    stamps, left, right = (
        np.concatenate(column)[order] for column in zip(*((each[0], each[2], each[3]) for each in parts), strict=True)
    )
    return _Columns(stamps, parts[0].labels, left, right)


def _no_rows(labels: tuple[str, ...], left: int, right: int) -> _Columns:
    return _Columns(np.empty(0, np.int64), labels, np.empty((0, left)), np.empty((0, right)))


def _looked_at(kind: _Kind, run: Messages, first: Record) -> _Columns | None:
    """The columns of messages that all have the layout of the first, None where one has not or is not valid."""
    layout, labels = Layout(next(payloads(run))), kind.of(first).labels
    try:
        layout.header()
        kind.place(layout, len(labels))
    except ValueError:
        return None
    rows = view(run, layout.dtype())
    stamps = None if rows is None else stamps_of(rows)
    if rows is None or stamps is None:
        return None
    numbers = kind.look(rows, first)
    return _Columns(stamps, labels, *numbers) if numbers else None


def _read(kind: _Kind, topic: Topic, run: Messages, number: int, labels: tuple[str, ...]) -> _Columns:
    """The columns of messages read one by one.

    Raises:
        ContractError: one is not valid, or has other labels.
    """
    rows = list[_Columns]()
    for place, data in enumerate(payloads(run), number):
        row = kind.of(read_record(topic, place, data))
        if row.labels != labels:
            what = f"message {place} of {topic.name} (stamp {row.stamps} ns) has the {kind.labels} "
            raise ContractError(what + ", ".join(row.labels), f"{', '.join(labels)} in every message")
        rows.append(row)
    stamps, _, left, right = zip(*rows, strict=True)
    return _Columns(np.array(stamps, np.int64), labels, np.array(left), np.array(right))


def _joint_row(record: Any) -> _Columns:
    if isinstance(record, DeltaCommand):
        return _Columns(record.stamp, record.names, record.delta, np.zeros(len(record.names)))
    return _Columns(record.stamp, record.names, record.position, record.velocity)


def _place_joints(layout: Layout, n: int) -> None:
    layout.count("names")
    for joint in range(n):
        layout.text(f"name {joint}")
    for field in ("position", "velocity", "effort"):
        layout.doubles(field, layout.count(field))


def _look_at_joints(rows: NDArray[np.void], first: Record) -> tuple[Floats, Floats] | None:
    position = rows["position"].astype(np.float64)
    rates = "velocity" in (rows.dtype.names or ()) and not isinstance(first, DeltaCommand)
    velocity = rows["velocity"].astype(np.float64) if rates else np.zeros_like(position)
    valid = np.isfinite(position).all() and np.isfinite(velocity).all()
    return (position, velocity) if valid else None


def _pose_row(record: Any) -> _Columns:
    return _Columns(record.stamp, (record.frame,), record.position, record.orientation)


def _place_pose(layout: Layout, _: int) -> None:
    layout.doubles("position", 3)
    layout.doubles("orientation", 4)


def _look_at_poses(rows: NDArray[np.void], _: Record) -> tuple[Floats, Floats] | None:
    position, orientation = rows["position"].astype(np.float64), rows["orientation"].astype(np.float64)
    with np.errstate(over="ignore"):
        unit = np.abs((orientation**2).sum(axis=1) - 1.0) <= UNIT_TOLERANCE
    return (position, orientation) if np.isfinite(position).all() and unit.all() else None


_JOINTS = _Kind("joints", _joint_row, _place_joints, _look_at_joints)
_POSES = _Kind("frame", _pose_row, _place_pose, _look_at_poses)
