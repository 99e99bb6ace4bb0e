"""Which parts of a recording are learned from: what is faulty, discarded or poor is left out, and it is said."""

from collections.abc import Callable
from typing import NamedTuple

from rled_msgs_py.bags import Bag, Review, review
from rled_msgs_py.bags.episodes import Episode
from rled_msgs_py.bags.faults import ASIDE, Fault
from rled_msgs_py.bags.quality import qualities
from rled_msgs_py.errors import RledError, command
from rled_msgs_py.topics import EPISODE_EVENTS, MARKED_EE_POSE, MARKED_JOINT_STATES

POINTS = {MARKED_JOINT_STATES.name, MARKED_EE_POSE.name}
"""Topics that the points of ζᵃ are read from; the trajectories are read from the others too."""

MOST_TOLD = 5
"""Faults of which each is told."""

Say = Callable[[str], None]


class SelectionError(RledError):
    """A recording with a fault that cannot be left out, or nothing in it good enough."""


class Episodes(NamedTuple):
    """Stretches of a recording.

    Attributes:
        spans: first and last moment (ns) of those to learn from, in order; None for all after the last mark.
        left_out: first moment and end (ns) of those that are not learned from.
    """

    spans: list[tuple[int, int]] | None
    left_out: list[tuple[int, int]]


def select_points(bag: Bag, say: Say) -> None:
    """See that the marks of a bag can be learned from, and say which are left out.

    Raises:
        SelectionError: they are faulty.
    """
    found = review(bag)
    _require_sound(bag, found, [fault for fault in found.faults if set(fault.topics) & POINTS])
    _say_faults(bag, found, [fault for fault in found.faults if set(fault.topics) & POINTS], say)
    dropped = [episode.number for episode in found.episodes if not episode.kept]
    if dropped:
        say(f"left out: marks of discarded {_names(dropped)}")


def select_episodes(bag: Bag, min_quality: float, say: Say) -> Episodes:
    """Choose the episodes of a bag, and say which are left out and why.

    Args:
        bag: a recording.
        min_quality: least score of a segment to a target, 0 to 1.
        say: takes each line.

    Raises:
        SelectionError: a fault spoils the whole recording, or no episode is left.
    """
    found = review(bag)
    _require_sound(bag, found, found.faults)
    reasons = {each.number: "discarded by the operator" for each in found.episodes if not each.kept}
    _say_faults(bag, found, [each for each in found.faults if _matters(each, bag, found, set(reasons))], say)
    poor = _poor_segments(bag, found, [each for each in found.episodes if each.number not in reasons], min_quality)
    for number, segments in poor.items():
        of = len(next(each for each in found.episodes if each.number == number).segments)
        if len(segments) == of:
            reasons[number] = f"quality below {min_quality:g}"
        else:
            parts = f"{len(segments)} of {of} segments of episode {number}"
            say(f"left out: {parts}: quality below {min_quality:g}")
    for reason in dict.fromkeys(reasons.values()):
        say(f"left out: {_names([number for number, why in reasons.items() if why == reason])}: {reason}")
    if found.episodes and len(reasons) == len(found.episodes):
        raise SelectionError(
            f"no episode of {bag.path} is left", "one or more", f"see: {command('demos', 'info', bag.path)}"
        )
    chosen = [_span(each, found) for each in found.episodes if each.number not in reasons and each.segments]
    left_out = [(each.first, each.last) for each in found.episodes if each.number in reasons]
    left_out += [segment for segments in poor.values() for segment in segments]
    return Episodes(chosen if bag.counts[EPISODE_EVENTS.name] else None, sorted(left_out))


def _say_faults(bag: Bag, found: Review, faults: list[Fault], say: Say) -> None:
    """Say in one line which moments are missing; what is around them is learned from."""
    if not faults:
        return
    told = [f"{_when(found, fault)} ({', '.join(fault.topics)}: {fault.what})" for fault in faults[:MOST_TOLD]]
    more = f" and {len(faults) - MOST_TOLD} more" if len(faults) > MOST_TOLD else ""
    say(f"left out: {', '.join(told)}{more}; see: {command('demos', 'check', bag.path)}")


def _matters(fault: Fault, bag: Bag, found: Review, left_out: set[int]) -> bool:
    """Whether there would be something to learn from at a fault."""
    if bag.counts[EPISODE_EVENTS.name]:
        return bool(set(found.episodes_of(fault)) - left_out)
    marks = found.series[MARKED_JOINT_STATES.name].moments
    return not len(marks) or fault.last > int(marks[-1])


def _when(found: Review, fault: Fault) -> str:
    begin, end = found.seconds(fault.first), found.seconds(fault.last)
    return f"{begin:.2f} s" if fault.first == fault.last else f"{begin:.2f} s to {end:.2f} s"


def _poor_segments(bag: Bag, found: Review, sound: list[Episode], least: float) -> dict[int, list[tuple[int, int]]]:
    """First and last moment (ns) of the segments to targets whose score is less than ``least``, by episode."""
    poor = dict[int, list[tuple[int, int]]]()
    segments = [each._replace(segments=(part,)) for each in sound for part in each.segments] if least > 0.0 else []
    for segment, quality in zip(segments, qualities(bag.task, found.timeline, segments), strict=True):
        if quality.score < least:
            poor.setdefault(segment.number, []).append(_span(segment, found))
    return poor


def _span(episode: Episode, found: Review) -> tuple[int, int]:
    """First and last moment (ns) of an episode's segments to targets."""
    first, last = found.timeline.moments[[episode.segments[0].first, episode.segments[-1].last]].tolist()
    return first, last


def _require_sound(bag: Bag, found: Review, faults: list[Fault]) -> None:
    for fault in faults:
        if fault.kind not in ASIDE:
            where = f"{', '.join(fault.topics)} at {found.seconds(fault.first):.2f} s"
            what = f"{bag.path} is faulty: {fault.kind}: {where}: {fault.what}"
            remedy = f"see what to do with: {command('demos', 'check', bag.path)}"
            raise SelectionError(what, "a bag without such faults", remedy)


def _names(numbers: list[int]) -> str:
    return f"episode{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
