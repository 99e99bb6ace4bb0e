"""What is wrong with a recording that can be read: each fault with its time and its remedy."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.series import Series
from rled_msgs_py.bags.stamps import fallen_back, interleaved
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import EE_POSE, JOINT_DELTA, JOINT_STATES, TASK_STATUS

TOPIC_TIMEOUT = 500_000_000
"""A topic that says nothing for so long while others go on has stopped (ns)."""
JUMP_FACTOR = 1.5
"""A step of the clock is a jump when it is longer than so many usual steps."""
TOGETHER = 25
"""Messages within which the same fault is counted as one."""

NO_ORDER, TWO_PUBLISHERS, RENAMED, INVALID = "stamps backwards", "two publishers", "names change", "not valid"
CLOCK_JUMP, STOPS, LOST = "clock jump", "topic stops", "messages lost"

ASIDE = (CLOCK_JUMP, STOPS, LOST, RENAMED, INVALID)
"""Faults that cost the moments they are at; the others spoil the whole recording."""


class Fault(NamedTuple):
    """One fault.

    Attributes:
        kind: in two words.
        topics: names of the topics that show it.
        first: moment at which it begins (ns).
        last: moment at which it ends (ns).
        what: the fault in words.
    """

    kind: str
    topics: tuple[str, ...]
    first: int
    last: int
    what: str


def find_faults(found: Mapping[str, Series], cuts: list[tuple[int, int]], period: int) -> list[Fault]:
    """The faults of a recording in the order of time.

    Args:
        found: its topics by name.
        cuts: moments between which parts were taken out on purpose.
        period: simulation time between ticks (ns).
    """
    faults = [fault for each in found.values() for fault in _of_topic(each, period)]
    if not any(fault.kind in (NO_ORDER, TWO_PUBLISHERS) for fault in faults):
        faults += [*_missing(found, period), *_clock(found[TASK_STATUS.name], cuts)]
        if not len(found[TASK_STATUS.name].stamps):
            faults += _long_steps(found[JOINT_STATES.name], cuts)
    faults = [_judged(fault, found[TASK_STATUS.name]) for fault in faults]
    return sorted(_joined(faults), key=lambda fault: (fault.first, fault.last, fault.kind))


def _of_topic(each: Series, period: int) -> Iterator[Fault]:
    yield from _misfits(each)
    stamps, moments, name = each.stamps, each.moments, each.topic.name
    for place in np.flatnonzero(fallen_back(stamps)).tolist():
        what = f"the stamp falls back by {(stamps[place - 1] - stamps[place]) * 1e-9:.3f} s"
        yield Fault(NO_ORDER, (name,), int(moments[place - 1]), int(moments[place]), what)
    same = np.zeros(len(stamps), dtype=bool)
    same[1:] = (np.diff(stamps) == 0) & (np.diff(each.values, axis=0) != 0).any(axis=1)
    for span in _groups(same):
        what = f"{len(span)} stamps come twice with different content"
        yield Fault(TWO_PUBLISHERS, (name,), int(moments[span[0]]), int(moments[span[-1]]), what)
    for span in _groups(interleaved(stamps)):
        what = f"stamps go back and forth {len(span)} times"
        kind = TWO_PUBLISHERS if len(span) > 1 else NO_ORDER
        yield Fault(kind, (name,), int(moments[span[0] - 1 :].min()), int(moments[span[-1] - 1]), what)
    for span in _groups(_zigzag(each, period)):
        if len(span) >= 3:
            what = f"two motions take turns, {len(span)} times, faster than the simulation's ticks"
            yield Fault(TWO_PUBLISHERS, (name,), int(moments[span[0]]), int(moments[span[-1]]), what)


def _zigzag(each: Series, period: int) -> NDArray[np.bool_]:
    """Where every other message goes on from the one before last, and messages come faster than ticks."""
    found = np.zeros(len(each.stamps), dtype=bool)
    if each.topic in (JOINT_STATES, EE_POSE) and len(found) > 2:
        steps, values = np.diff(each.stamps), each.values
        beside = np.abs(np.diff(values, axis=0)).max(axis=1)
        across = np.abs(values[2:] - values[:-2]).max(axis=1)
        fast = (steps[:-1] > 0) & (steps[:-1] < 0.9 * period) & (steps[:-1] + steps[1:] > 0.5 * period)
        found[1:-1] = fast & (np.minimum(beside[:-1], beside[1:]) > 4.0 * across + 1e-6)
    return found


def _misfits(each: Series) -> Iterator[Fault]:
    for kind, is_renamed in ((RENAMED, True), (INVALID, False)):
        of_kind = [misfit for misfit in each.misfits if misfit.is_renamed == is_renamed]
        apart = np.flatnonzero(np.diff([misfit.moment for misfit in of_kind]) > TOPIC_TIMEOUT) + 1
        for begin, end in pairwise([0, *apart.tolist(), len(of_kind)] if of_kind else []):
            first, last = of_kind[begin], of_kind[end - 1]
            more = f" (and {end - begin - 1} more)" if end - begin > 1 else ""
            yield Fault(kind, (each.topic.name,), first.moment, last.moment, first.what + more)


def _missing(found: Mapping[str, Series], period: int) -> Iterator[Fault]:
    """State topics and answers that are missing at ticks that others have."""
    states = [found[topic.name] for topic in STATE_TOPICS if len(found[topic.name].stamps)]
    if not states:
        return
    ticks = np.unique(np.concatenate([each.moments for each in states]))
    whole = ticks[np.all([np.isin(ticks, each.moments) for each in states], axis=0)]
    ticks = ticks[ticks >= whole[0]] if len(whole) else ticks  # the recorder came upon the topics one by one
    for each in states:
        told = [misfit.moment for misfit in each.misfits]
        yield from _silences(each, ticks, ~np.isin(ticks, [*each.moments, *told]), period)
    delta, status = found[JOINT_DELTA.name], found[TASK_STATUS.name]
    if len(delta.stamps):
        last = status.moments[status.values[:, 3] > 0] if len(status.stamps) else ticks[:0]
        held = status.moments[:-1][holds(status)] if len(status.stamps) else ticks[:0]
        unanswered = ~np.isin(ticks, delta.moments) & ~np.isin(ticks, [*last, *held])
        for fault in _silences(delta, ticks, unanswered, period):
            if fault.kind == STOPS:
                yield fault


def _silences(each: Series, ticks: NDArray[np.int64], missing: NDArray[np.bool_], period: int) -> Iterator[Fault]:
    missing = missing.copy()
    if each.topic == JOINT_DELTA:
        missing[ticks < each.moments[0]] = False  # nobody drove yet
    missing[-1:] = False  # the recorder left in the middle of a tick
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]])))
    for first, stop in edges.reshape(-1, 2).tolist():
        count, name = stop - first, each.topic.name
        span = int(ticks[stop - 1]), int(ticks[first])
        if span[0] - span[1] + period >= TOPIC_TIMEOUT:
            yield Fault(STOPS, (name,), span[1], span[0], f"nothing for {(span[0] - span[1] + period) * 1e-9:.2f} s")
        else:
            yield Fault(LOST, (name,), span[1], span[0], f"{count} messages are missing")


def _clock(status: Series, cuts: list[tuple[int, int]]) -> Iterator[Fault]:
    """Ticks lost on all topics, and stamps that jump while the steps are counted on."""
    if len(status.stamps) < 3:
        return
    steps = np.diff(status.moments)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    same = np.diff(status.values[:, 0]) == 0
    counted = np.diff(status.values[:, 1])
    cut = np.isin(status.moments[1:], [after for _, after in cuts])
    long = same & (counted >= 0) & (steps > JUMP_FACTOR * usual) & ~cut
    in_real_time = bool(
        (holds(status) & (steps < JUMP_FACTOR * usual)).any()
    )  # and then a period may pass without a step
    lost = same & (counted > 1) & ~cut | long & ((counted == 0) | in_real_time)
    every = tuple(topic.name for topic in STATE_TOPICS)
    for place in np.flatnonzero(lost).tolist():
        missing, why = int(counted[place]) - 1, "the step counter jumps"
        if in_real_time or missing < 0:
            missing, why = round(steps[place] / usual) - 1, f"nothing for {steps[place] * 1e-9:.2f} s"
        what = f"{missing} ticks are missing: {why}"
        yield Fault(LOST, every, int(status.moments[place]), int(status.moments[place + 1]), what)
    for place in np.flatnonzero(long & ~lost & (counted == 1)).tolist():
        what = f"the stamp jumps ahead by {steps[place] * 1e-9:.3f} s within one step"
        yield Fault(CLOCK_JUMP, every, int(status.moments[place]), int(status.moments[place + 1]), what)


def holds(status: Series) -> NDArray[np.bool_]:
    """Whether each status but the last is followed by one of the same step: nobody commanded, shape (k - 1,)."""
    steps: NDArray[np.bool_] = (np.diff(status.values[:, :2], axis=0) == 0).all(axis=1) & (np.diff(status.moments) > 0)
    return steps


def _long_steps(states: Series, cuts: list[tuple[int, int]]) -> Iterator[Fault]:
    """Jumps of the clock in a recording that counts no steps: ten usual steps and half a second."""
    steps = np.diff(states.moments)
    if len(steps) > 2:
        cut = np.isin(states.moments[1:], [after for _, after in cuts])
        for place in np.flatnonzero((steps > max(10.0 * np.median(steps), TOPIC_TIMEOUT)) & ~cut).tolist():
            what = f"the stamp jumps ahead by {steps[place] * 1e-9:.3f} s"
            span = int(states.moments[place]), int(states.moments[place + 1])
            yield Fault(CLOCK_JUMP, (states.topic.name,), *span, what)


def _judged(fault: Fault, status: Series) -> Fault:
    """A stamp that falls back while the simulation counts its steps on is a jump of the clock."""
    if fault.kind != NO_ORDER or len(status.stamps) < 2:
        return fault
    place = int(np.searchsorted(status.moments, fault.last))
    if 0 < place < len(status.stamps):
        before, after = status.values[place - 1], status.values[place]
        if before[0] == after[0] and after[1] == before[1] + 1:
            return fault._replace(kind=CLOCK_JUMP)
    return fault


def _groups(marked: NDArray[np.bool_]) -> Iterator[list[int]]:
    """Marked places, those that lie close together as one."""
    places = np.flatnonzero(marked)
    for group in np.split(places, np.flatnonzero(np.diff(places) > TOGETHER) + 1):
        if len(group):
            yield group.tolist()


def _joined(faults: list[Fault]) -> list[Fault]:
    """The same fault of several topics as one."""
    by_span = dict[tuple[object, ...], Fault]()
    for fault in faults:
        key = (fault.kind, fault.first, fault.last, fault.what)
        known = by_span.get(key)
        by_span[key] = known._replace(topics=(*known.topics, *fault.topics)) if known else fault
    return list(by_span.values())
