"""The messages of one topic as rows over time, whatever is wrong with them: what checks and episodes are made of."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.error import BagError
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import decode
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, Record, TaskStatus
from rled_msgs_py.topics import JOINT_STATE, POSE_STAMPED, Topic

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

NEAR = 3
"""Messages within which setbacks of the stamp that are made good again belong together."""


class Misfit(NamedTuple):
    """A message that is no row.

    Attributes:
        moment: that of the last row before it (ns).
        what: why, in words.
        is_renamed: it is valid, but of other joints or in another frame than the first.
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
        names: joint names, or the frame alone.
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


def fallen_back(stamps: Times) -> NDArray[np.bool_]:
    """Where a stamp is less than the one before and what follows does not make it good, shape (k,)."""
    back = np.diff(stamps, prepend=stamps[:1]) < 0
    return back & ~interleaved(stamps)


def interleaved(stamps: Times) -> NDArray[np.bool_]:
    """Where a stamp is less than the one before, but the next one is not: as when two publishers take turns."""
    back = np.diff(stamps, prepend=stamps[:1]) < 0
    returns = np.zeros(len(stamps), dtype=bool)
    returns[1:-1] = stamps[2:] >= stamps[:-2]
    return back & returns


def going_on(stamps: Times) -> Times:
    """Moments: the stamps, each run that began anew moved to just after the run before it (ns), shape (k,)."""
    fallen = fallen_back(stamps)
    if not fallen.any():
        return stamps
    steps = np.diff(stamps)
    usual = int(np.median(steps[steps > 0])) if (steps > 0).any() else 1
    falls = np.zeros(len(stamps), np.int64)
    falls[1:] = np.where(fallen[1:], usual - steps, 0)
    moments: Times = stamps + np.cumsum(falls)
    return moments


def _at_once(bag: Bag, topic: Topic) -> Series:
    if topic.type == JOINT_STATE:
        joints = bag.joints(topic)
        return Series(topic, joints.stamps, going_on(joints.stamps), joints.names, joints.position)
    if topic.type == POSE_STAMPED:
        poses = bag.poses(topic)
        values = np.hstack([poses.position, poses.orientation])
        return Series(topic, poses.stamps, going_on(poses.stamps), (poses.frame,), values)
    return _of(topic, bag.records(topic), ())


def _of(topic: Topic, records: Iterable[Record], misfits: Sequence[Misfit]) -> Series:
    rows = [_row(record) for record in records]
    stamps = np.array([stamp for stamp, _, _ in rows], np.int64)
    names, width = (rows[0][1], len(rows[0][2])) if rows else ((), 0)
    values = np.array([values for *_, values in rows], float).reshape(len(rows), width)
    return Series(topic, stamps, going_on(stamps), names, values, tuple(misfits))


def _one_by_one(bag: Bag, topic: Topic) -> Series:
    records, faults = list[Record](), list[tuple[int, str, bool]]()
    for number, message in enumerate(bag.messages(topic)):
        try:
            record = decode(topic, message.data)
            names, expected = _row(record)[1], _row(records[0])[1] if records else ()
        except ContractError as error:
            faults.append((len(records), f"message {number} is not valid: {error.what}", False))
            continue
        if records and names != expected:
            what = f"message {number} is of {', '.join(names)}, the first of {', '.join(expected)}"
            faults.append((len(records), what, True))
        else:
            records.append(record)
    found = _of(topic, records, ())
    moments = [0, *found.moments.tolist()]
    return found._replace(misfits=tuple(Misfit(moments[place], what, renamed) for place, what, renamed in faults))


def _row(record: Record) -> tuple[int, tuple[str, ...], list[float]]:
    if isinstance(record, JointSample):
        return record.stamp, record.names, record.position.tolist()
    if isinstance(record, DeltaCommand):
        return record.stamp, record.names, record.delta.tolist()
    if isinstance(record, PoseSample):
        return record.stamp, (record.frame,), [*record.position.tolist(), *record.orientation.tolist()]
    assert isinstance(record, TaskStatus)
    is_last = record.terminated or record.truncated
    return record.stamp, (), [record.episode, record.step, record.targets_reached, is_last]
