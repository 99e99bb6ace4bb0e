"""The messages of one topic as rows over time, whatever is wrong with them: what checks and episodes are made of."""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.error import BagError
from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.bags.joint_rows import joint_rows
from rled_msgs_py.bags.stamps import Times, going_on
from rled_msgs_py.bags.tables import JointTable, joint_table_of
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import decode
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, Record, TaskStatus
from rled_msgs_py.topics import EE_POSE, JOINT_STATE, JOINT_STATES, POSE_STAMPED, TASK_DESCRIPTION, Topic

Floats = NDArray[np.float64]

MAX_ADVANCE = 1_000_000_000
"""How long after the last message of a topic a stamp that nothing else confirms is believed (ns)."""


class Misfit(NamedTuple):
    """A message that is no row.

    Attributes:
        moment: its own, or that of the last message before it where it has none (ns).
        what: why, in words.
        is_renamed: it is valid, but lacks joints or is in another frame than the first.
    """

    moment: int
    what: str
    is_renamed: bool


class Series(NamedTuple):
    """The messages of one topic in log order, k of them.

    Attributes:
        topic: of the contract.
        stamps: simulation time (ns), shape (k,).
        moments: the same, but going on where a stamp falls back for good (ns), shape (k,).
        names: names of the task's joints, or the frame alone.
        values: numbers of each message, shape (k, v); joint messages: angles (rad), poses: position (m) and
            orientation, statuses: episode, step, targets reached, whether it is the last of its episode.
        misfits: messages that are not among the rows.
    """

    topic: Topic
    stamps: Times
    moments: Times
    names: tuple[str, ...]
    values: Floats
    misfits: tuple[Misfit, ...] = ()


def series(bag: Bag, topic: Topic) -> Series:
    """Read a topic.

    Raises:
        BagError: the file is damaged, or the topic is of another type.
    """
    try:
        return _at_once(bag, topic)
    except BagError:
        return _one_by_one(bag, topic)


def _at_once(bag: Bag, topic: Topic) -> Series:
    if topic.type == JOINT_STATE:
        return _of_joints(bag, topic, bag.joints(topic), [])
    if topic.type == POSE_STAMPED:
        poses = bag.poses(topic)
        values = np.hstack([poses.position, poses.orientation])
        return Series(topic, poses.stamps, going_on(poses.stamps), (poses.frame,), values)
    return _of(topic, bag.records(topic), ())


class _Unread(NamedTuple):
    """A message that cannot be read: its number among all, how many can be before it, its stamp if it has one, why."""

    number: int
    before: int
    stamp: int | None
    what: str

    def misfit(self, moments: Times) -> Misfit:
        """Told at its own time if that lies between those of its neighbours, else at that of the one before it."""
        low = int(moments[self.before - 1]) if self.before else 0
        high = int(moments[self.before]) if self.before < len(moments) else low + MAX_ADVANCE
        stamp = self.stamp if self.stamp is not None and low <= self.stamp <= high else low
        return Misfit(stamp, f"message {self.number} is not valid: {self.what}", False)


def _of_joints(bag: Bag, topic: Topic, table: JointTable, unread: list[_Unread]) -> Series:
    """Joint messages as rows of the task's joints.

    Args:
        bag: where they lie.
        topic: theirs.
        table: those that can be read.
        unread: those that cannot.
    """
    wanted = bag.task.joint_names if bag.counts[TASK_DESCRIPTION.name] else table.names
    if not set(wanted) <= set(table.names):
        return Series(topic, table.stamps, going_on(table.stamps), table.names, table.position, ())
    rows = joint_rows(table, wanted, partial(_stamps_of_ticks, bag) if topic == JOINT_STATES else None)
    numbers = np.delete(np.arange(len(table.stamps) + len(unread)), [each.number for each in unread])
    moments, all_moments = going_on(rows.stamps), going_on(table.stamps)
    misfits = [
        Misfit(int(all_moments[row]), f"message {numbers[row]} {what}", is_renamed)
        for row, what, is_renamed in rows.odd
    ]
    misfits += [each.misfit(all_moments) for each in unread]
    return Series(topic, rows.stamps, moments, wanted, rows.position, tuple(sorted(misfits)))


def _stamps_of_ticks(bag: Bag) -> Times:
    try:
        return bag.poses(EE_POSE).stamps
    except BagError:
        return np.empty(0, np.int64)


def _of(topic: Topic, records: Iterable[Record], misfits: Sequence[Misfit]) -> Series:
    rows = [_row(record) for record in records]
    stamps = np.array([stamp for stamp, _, _ in rows], np.int64)
    names, width = (rows[0][1], len(rows[0][2])) if rows else ((), 0)
    values = np.array([values for *_, values in rows], float).reshape(len(rows), width)
    return Series(topic, stamps, going_on(stamps), names, values, tuple(misfits))


def _one_by_one(bag: Bag, topic: Topic) -> Series:
    records, renamed, unread = list[Record](), list[tuple[int, str]](), list[_Unread]()
    for number, message in enumerate(bag.messages(topic)):
        try:
            record = decode(topic, message.data)
        except ContractError as error:
            unread.append(_Unread(number, len(records), stamp_of(topic.type, message.data), error.what))
            continue
        first = records[0] if records else record
        if isinstance(first, PoseSample) and isinstance(record, PoseSample) and record.frame != first.frame:
            renamed.append((len(records), f"message {number} is of {record.frame}, the first of {first.frame}"))
        else:
            records.append(record)
    if topic.type == JOINT_STATE:
        return _of_joints(bag, topic, joint_table_of(cast(list[JointSample | DeltaCommand], records)), unread)
    found = _of(topic, records, ())
    misfits = [each.misfit(found.moments) for each in unread]
    misfits += [Misfit(int(found.moments[place - 1]), what, True) for place, what in renamed]
    return found._replace(misfits=tuple(sorted(misfits)))


def _row(record: Record) -> tuple[int, tuple[str, ...], list[float]]:
    if isinstance(record, PoseSample):
        return record.stamp, (record.frame,), [*record.position.tolist(), *record.orientation.tolist()]
    assert isinstance(record, TaskStatus)
    is_last = record.terminated or record.truncated
    return record.stamp, (), [record.episode, record.step, record.targets_reached, is_last]
