"""New bags made of recorded ones: a stretch of one, one without some episodes.

A copy appears whole, under its own name only when it is complete. Where a part was taken out the metadata say so, so
that the gap is no fault.
"""

import json
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.episodes import CUTS, Episode, cuts, episodes, event_of, find_segments
from rled_msgs_py.bags.error import BagError, Unwritten
from rled_msgs_py.bags.header import sim_stamp
from rled_msgs_py.bags.holding import require_idle, temporary_folder
from rled_msgs_py.bags.series import series
from rled_msgs_py.bags.stamps import going_on
from rled_msgs_py.bags.stream import Message
from rled_msgs_py.bags.timeline import Timeline, read_timeline
from rled_msgs_py.bags.writer import BagWriter, making_way, require_replaceable
from rled_msgs_py.errors import command
from rled_msgs_py.messages import NANOSECONDS, decode
from rled_msgs_py.records import Text
from rled_msgs_py.tick import STATE_NAMES
from rled_msgs_py.topics import EPISODE_EVENTS, JOINT_STATES, ROBOT_DESCRIPTION, TASK_DESCRIPTION, Topic

DESCRIPTIONS = (ROBOT_DESCRIPTION.name, TASK_DESCRIPTION.name)
MAX_SECONDS = 1e9
"""More seconds than a recording has."""
Report = Callable[[int], None]
Cuts = list[tuple[int, int]]


class Dated(NamedTuple):
    """A message with its topic's name and its moment (ns); what has no stamp has that of the stamped one before it."""

    name: str
    moment: int
    message: Message


def dated(bag: Bag) -> Iterator[Dated]:
    """All messages in log order, with moments that go on where the simulation was restarted.

    Raises:
        BagError: the file is damaged.
    """
    of_states = np.array([stamp or 0 for _, stamp, _ in _stamped(bag, JOINT_STATES)], np.int64)
    shifts = iter((going_on(of_states) - of_states).tolist())
    shift, moment = 0, next((stamp for _, stamp, _ in _stamped(bag) if stamp is not None), 0)
    for name, stamp, message in _stamped(bag):
        shift = next(shifts) if name == JOINT_STATES.name else shift
        moment = moment if stamp is None else stamp + shift
        yield Dated(name, moment, message)


def _stamped(bag: Bag, *topics: Topic) -> Iterator[tuple[str, int | None, Message]]:
    for message in bag.messages(*topics):
        name = bag.name_of(message)
        yield name, sim_stamp(name, message.topic.type, message.data), message


def trim(bag: Bag, output: Path, begin: float, end: float, report: Report, *, overwrite: bool = False) -> int:
    """Copy the messages from ``begin`` up to ``end``, in seconds since the first state; returns how many.

    The descriptions are kept, and the events of each episode of which a part is left.

    Raises:
        BagError: nothing is left, the bag is damaged, or the copy cannot be written.
    """
    states = series(bag, JOINT_STATES).moments
    zero = int(states[0]) if len(states) else next(dated(bag)).moment
    first, stop = _moment(zero, begin), _moment(zero, end)
    timeline = read_timeline(bag) if bag.counts[EPISODE_EVENTS.name] else None
    of = (
        {each.number for each in episodes(bag, timeline) if each.first < stop and each.last >= first}
        if timeline
        else set()
    )

    def stays(each: Dated) -> bool:
        if each.name == EPISODE_EVENTS.name:
            return _episode_of(bag, each) in of
        return each.name in DESCRIPTIONS or first <= each.moment < stop

    return _copy(bag, output, stays, cuts(bag), report, overwrite)


def _moment(zero: int, seconds: float) -> float:
    """A moment so many seconds after another (ns)."""
    return (
        zero + round(min(max(seconds, -MAX_SECONDS), MAX_SECONDS) * NANOSECONDS) if math.isfinite(seconds) else seconds
    )


def drop(bag: Bag, output: Path, numbers: Collection[int], report: Report, *, overwrite: bool = False) -> int:
    """Copy everything but some episodes; returns how many messages.

    Raises:
        BagError: there is no such episode, nothing is left, the bag is damaged, or the copy cannot be written.
    """
    timeline = read_timeline(bag)
    found = {episode.number: episode for episode in episodes(bag, timeline)}
    unknown = sorted(set(numbers) - set(found))
    if unknown:
        accepted = f"{min(found)} to {max(found)}" if found else "none: the bag has no episodes"
        raise BagError(f"{bag.path} has no episode {unknown[0]}", accepted, _look_at(bag))
    has_events = bool(bag.counts[EPISODE_EVENTS.name])
    starts = {segment.first for segment in find_segments(timeline, cuts(bag))}
    spans = _joined([_span(found[number], timeline, starts, has_events) for number in sorted(set(numbers))])

    def stays(each: Dated) -> bool:
        name, moment, _ = each
        if name == EPISODE_EVENTS.name:
            return _episode_of(bag, each) not in numbers
        if name in DESCRIPTIONS:
            return True
        # the state that a motion begins with is where the one before it arrived
        within = (first + (name in STATE_NAMES and not has_events) <= moment < stop for first, stop in spans)
        return not any(within)

    gone = [_gap(timeline, span, has_events) for span in spans]
    return _copy(bag, output, stays, sorted(cuts(bag) + gone), report, overwrite)


def _look_at(bag: Bag) -> str:
    return f"see what it holds with: {command('demos', 'info', bag.path)}"


def leave_out(bag: Bag, output: Path, begin: float, end: float, report: Report, *, overwrite: bool = False) -> int:
    """Copy everything but what lies between ``begin`` and ``end``, in seconds since the first state; returns how many.

    Raises:
        BagError: no tick is left, the bag is damaged, or the copy cannot be written.
    """
    states, timeline = series(bag, JOINT_STATES).moments, read_timeline(bag)
    zero = int(states[0]) if len(states) else next(dated(bag)).moment
    first, stop = _moment(zero, begin), _moment(zero, end)
    before, after = timeline.moments[timeline.moments < first], timeline.moments[timeline.moments >= stop]
    if not len(before) + len(after):
        raise BagError(f"nothing of {bag.path} is left", "a stretch with messages", _look_at(bag))
    latest, last = zero, int(timeline.moments[-1]) + NANOSECONDS

    def stays(each: Dated) -> bool:
        nonlocal latest  # a message that cannot be read may say any time
        latest = each.moment if zero - NANOSECONDS <= each.moment <= last else latest
        return each.name in (*DESCRIPTIONS, EPISODE_EVENTS.name) or not first <= latest < stop

    gone = [(int(before[-1]), int(after[0]))] if len(before) and len(after) else []
    return _copy(bag, output, stays, sorted(cuts(bag) + gone), report, overwrite)


def _span(episode: Episode, timeline: Timeline, starts: set[int], has_events: bool) -> tuple[int, int]:
    """First moment and end of what goes with an episode (ns)."""
    last = episode.segments[-1].last if episode.segments else len(timeline.moments) - 1
    led_on = not has_events and last in starts
    return episode.first, episode.last + (not led_on)


def _joined(spans: Cuts) -> Cuts:
    """Spans in order, those that follow each other without a gap as one."""
    joined = Cuts()
    for first, stop in spans:
        if joined and first <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
        else:
            joined.append((first, stop))
    return joined


def _gap(timeline: Timeline, span: tuple[int, int], has_events: bool) -> tuple[int, int]:
    """Last moment before and first moment after what goes (ns)."""
    first, stop = np.searchsorted(timeline.moments, span).tolist()
    before = timeline.moments[max(first - has_events, 0)]
    return int(before), int(timeline.moments[min(stop, len(timeline.moments) - 1)])


def _episode_of(bag: Bag, each: Dated) -> int:
    record = decode(EPISODE_EVENTS, each.message.data)
    assert isinstance(record, Text)
    number: int = event_of(bag.path, record.data)["episode"]
    return number


def _copy(
    bag: Bag, output: Path, stays: Callable[[Dated], bool], taken_out: Cuts, report: Report, overwrite: bool
) -> int:
    metadata = {**bag.metadata, **({CUTS: json.dumps(taken_out)} if taken_out else {})}
    copied = 0
    with whole(output, metadata, overwrite, [bag]) as writer:
        for each in dated(bag):
            report(1)
            if stays(each):
                message = each.message
                writer.copy(message.topic, message.data, message.log_time, message.publish_time)
                copied += each.name not in DESCRIPTIONS
        if not copied:
            raise BagError(f"nothing of {bag.path} is left", "a stretch with messages", _look_at(bag))
        return int(writer.counts.total())


@contextmanager
def whole(
    output: Path, metadata: Mapping[str, str], overwrite: bool, sources: Iterable[Bag] = ()
) -> Iterator[BagWriter]:
    """Write a bag that takes its name when the block ends without an error.

    Raises:
        BagError: something is there that may not be replaced or is one of the sources, or it cannot be written.
    """
    output = Path(output)
    _require_other(output, sources)
    with ExitStack() as stack:
        with _located(output):
            if output.exists():
                require_replaceable(output, overwrite)
                require_idle(output)
            output.parent.mkdir(parents=True, exist_ok=True)
            made = stack.enter_context(temporary_folder(output)) / output.name
        try:
            with BagWriter(made, metadata=metadata) as writer:
                yield writer
        except Unwritten as error:
            raise BagError(f"writing {output} failed: {error.reason}; nothing has changed", "", "free space") from error
        with _located(output), making_way(output, overwrite):
            made.rename(output)


@contextmanager
def _located(output: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise BagError(f"the folder {output} cannot be made: {error.strerror}") from None


def _require_other(output: Path, sources: Iterable[Bag]) -> None:
    for bag in sources:
        folder = bag.path if bag.path.is_dir() else bag.path.parent
        if output.exists() and output.samefile(folder):
            raise BagError(f"{output} is the bag that is read", "another folder for the new bag", "choose another name")
