"""A recording divided into episodes, by the recorder's events or else by the task's counters.

An event is JSON on ``episode_events``: ``event`` is ``start``, ``stop``, ``keep`` or ``discard``, with the number of
its ``episode`` and a ``stamp`` (ns); other fields (``operator``, ``outcome``) say more. A bag without events has an
episode for each target that was pursued. What comes before the last mark, of an episode or of a bag without events, is
no segment.
"""

from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.error import BagError
from rled_msgs_py.bags.series import series
from rled_msgs_py.bags.stamps import Times
from rled_msgs_py.bags.timeline import Timeline
from rled_msgs_py.errors import ContractError
from rled_msgs_py.records import Text
from rled_msgs_py.topics import EPISODE_EVENTS, MARKED_JOINT_STATES
from rled_msgs_py.untrusted import read_json

EVENTS = ("start", "stop", "keep", "discard")
FOREVER = 2**63 - 1
MAX_EPISODE = 2**31
CUTS = "cuts"
"""Key of the metadata that lists where parts were taken out of a bag on purpose: pairs of moments (ns), JSON."""


class Segment(NamedTuple):
    """The trajectory to one target.

    Attributes:
        first: its first row of the timeline.
        last: the row that it led to; the target of that row may be the next one already.
        reached: whether the target was reached.
    """

    first: int
    last: int
    reached: bool


class Episode(NamedTuple):
    """One demonstration.

    Attributes:
        number: as counted by the recorder, or from 0.
        first: when it begins (ns).
        last: when it ends (ns).
        segments: the trajectories to its targets, in order.
        kept: False when its operator discarded it.
        operator: who drove; empty when not known.
        outcome: in the operator's words; empty when not known.
    """

    number: int
    first: int
    last: int
    segments: tuple[Segment, ...]
    kept: bool = True
    operator: str = ""
    outcome: str = ""


def episodes(bag: Bag, timeline: Timeline) -> list[Episode]:
    """The episodes of a recording, discarded ones too.

    Raises:
        BagError: the file is damaged, or an event cannot be read.
    """
    segments, spans = find_segments(timeline, cuts(bag)), _spans(events(bag))
    marks = series(bag, MARKED_JOINT_STATES).moments
    if not spans:
        begin = _row_after(marks, timeline)
        after = [segment._replace(first=max(segment.first, begin)) for segment in segments if segment.last > begin]
        return [_of_segment(number, segment, timeline) for number, segment in enumerate(after)]
    end = int(timeline.moments[-1]) if len(timeline.moments) else 0
    return [
        span._replace(last=min(span.last, end), segments=tuple(_within(span, segments, timeline, marks)))
        for span in spans
    ]


def find_segments(timeline: Timeline, taken_out: list[tuple[int, int]]) -> list[Segment]:
    """The trajectories to targets: one ends where the target is reached, or episode or run of the simulation change.

    A tick that repeats the step is a hold: in real time nobody commanded. Ticks that were lost, or taken out while the
    same target was pursued, divide no segment either.
    """
    if not len(timeline.moments):
        return []
    goes_on = _goes_on(timeline) & ~_parted(timeline, taken_out)
    starts = np.flatnonzero(np.append(True, ~goes_on | (np.diff(timeline.reached) != 0)))
    stops = np.append(starts[1:], len(timeline.moments))
    found = []
    for first, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        led_on = stop < len(timeline.moments) and bool(goes_on[stop - 1])
        if timeline.answered[first:stop].any():
            reached = led_on and bool(timeline.reached[stop] > timeline.reached[stop - 1])
            found.append(Segment(first, stop if led_on else stop - 1, reached))
    return found


def _goes_on(timeline: Timeline) -> NDArray[np.bool_]:
    """Whether each tick but the first continues the episode of the one before it, shape (k - 1,)."""
    counted = np.diff(timeline.step)
    anew = timeline.is_anew[1:] & (
        counted != 1
    )  # a clock that was set back while the steps are counted on is no restart
    goes_on: NDArray[np.bool_] = (
        (np.diff(timeline.episode) == 0) & (counted >= 0) & (np.diff(timeline.reached) >= 0) & ~anew
    )
    return goes_on


def _parted(timeline: Timeline, taken_out: list[tuple[int, int]]) -> NDArray[np.bool_]:
    """Whether a part was taken out before each tick but the first, with the target that it led to, shape (k - 1,)."""
    cut = np.isin(timeline.moments[1:], [after for _, after in taken_out])
    cut &= (np.diff(timeline.reached) != 0) | (np.diff(timeline.target, axis=0) != 0).any(axis=1)
    return cut


def events(bag: Bag) -> list[dict[str, Any]]:
    """The recorder's events, in order.

    Raises:
        BagError: one cannot be read.
    """
    return [event_of(bag.path, cast(Text, record).data) for record in bag.records(EPISODE_EVENTS)]


def cuts(bag: Bag) -> list[tuple[int, int]]:
    """Where parts were taken out on purpose: the last moment before and the first after (ns).

    Raises:
        BagError: the metadata cannot be read.
    """
    text = bag.metadata.get(CUTS, "[]")
    try:
        pairs = read_json(text, CUTS)
        found = [(before, after) for before, after in pairs]
        if isinstance(pairs, list) and all(map(_is_moment, chain.from_iterable(found))):
            return found
    except (ContractError, ValueError, TypeError):
        pass
    raise BagError(f"{bag.path} has the {CUTS} '{text[:80]}'", "a list of pairs of moments (ns)")


def discarded(bag: Bag) -> list[tuple[int, int]]:
    """First and last moment (ns) of the episodes that their operator discarded.

    Raises:
        BagError: an event cannot be read.
    """
    return [(span.first, span.last) for span in _spans(events(bag)) if not span.kept]


def event_of(path: Path, text: str) -> dict[str, Any]:
    """Read an event.

    Raises:
        BagError: it cannot be read; names the bag.
    """
    try:
        event: dict[str, Any] = read_json(text, EPISODE_EVENTS.name)
        number, stamp = event["episode"], event["stamp"]
        if event["event"] in EVENTS and _is_moment(stamp) and type(number) is int and 0 <= number <= MAX_EPISODE:
            return event
    except (ContractError, KeyError, TypeError):
        pass
    accepted = f"JSON with event ({', '.join(EVENTS)}), episode and stamp"
    raise BagError(f"{path} has the message '{text[:80]}' on {EPISODE_EVENTS.name}", accepted)


def _is_moment(value: Any) -> bool:
    return type(value) is int and abs(value) < FOREVER


def _spans(found: list[dict[str, Any]]) -> list[Episode]:
    """Episodes by their events; one that has not stopped reaches to the end."""
    spans = dict[int, Episode]()
    for event in found:
        number, stamp = event["episode"], event["stamp"]
        span = spans.get(number, Episode(number, 0, FOREVER, ()))  # begun in a part before, if no event tells its start
        if event["event"] == "start":
            span = span._replace(first=stamp)
        elif event["event"] == "stop":
            span = span._replace(last=stamp)
        else:
            span = span._replace(kept=event["event"] == "keep")
        operator, outcome = (str(event.get(key) or getattr(span, key)) for key in ("operator", "outcome"))
        spans[number] = span._replace(operator=operator, outcome=outcome)
    return sorted(spans.values(), key=lambda span: span.first)


def _of_segment(number: int, segment: Segment, timeline: Timeline) -> Episode:
    outcome = "reached" if segment.reached else ""
    return Episode(
        number, int(timeline.moments[segment.first]), int(timeline.moments[segment.last]), (segment,), outcome=outcome
    )


def _row_after(marks: Times, timeline: Timeline) -> int:
    """The first row after the last of some marks; before it the operator did not go for targets."""
    return int(np.searchsorted(timeline.moments, marks[-1], side="right")) if len(marks) else 0


def _within(span: Episode, segments: list[Segment], timeline: Timeline, marks: Times) -> list[Segment]:
    """The parts of segments that lie in a span, after its last mark."""
    first, stop = np.searchsorted(timeline.moments, [span.first, min(span.last, FOREVER - 1) + 1]).tolist()
    first = max(first, _row_after(marks[(marks >= span.first) & (marks <= span.last)], timeline))
    clipped = []
    for segment in segments:
        begin, end = max(segment.first, first), min(segment.last, stop - 1)
        if begin < end and timeline.answered[begin:end].any():
            clipped.append(Segment(begin, end, segment.reached and end == segment.last))
    return clipped
