"""Several recordings as one."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.copies import DESCRIPTIONS, Cuts, Report, dated, whole
from rled_msgs_py.bags.episodes import CUTS, Episode, cuts, episodes, events
from rled_msgs_py.bags.error import BagError
from rled_msgs_py.bags.header import moved
from rled_msgs_py.bags.stamps import fallen_back
from rled_msgs_py.bags.timeline import Timeline, read_timeline
from rled_msgs_py.bags.writer import BagWriter
from rled_msgs_py.errors import command
from rled_msgs_py.messages import NANOSECONDS
from rled_msgs_py.records import Text
from rled_msgs_py.topics import EPISODE_EVENTS, JOINT_STATES

APART = NANOSECONDS
"""Simulation time between two merged recordings (ns)."""


def merge(bags: Sequence[Bag], output: Path, report: Report, *, overwrite: bool = False) -> int:
    """Copy several recordings of one robot and task behind each other; returns how many messages.

    Stamps and log times of the later ones are moved on. Episodes are numbered anew, and told by events.

    Raises:
        BagError: robot or task differ, stamps fall back, a bag is damaged, or the copy cannot be written.
    """
    for bag in bags:
        _require_fit(bags[0], bag)
    shared = dict(set.intersection(*(set(bag.metadata.items()) for bag in bags)))
    taken_out, steps = Cuts(), list[_Step]()
    shift = log_shift = number = 0
    for bag in bags:
        extent, line = _extent(bag), read_timeline(bag)
        if steps:
            shift = steps[-1].last + APART - extent.first
            log_shift = steps[-1].last_log + APART - extent.first_log
        taken_out += [(steps[-1].last_tick, int(line.moments[0]) + shift)] if steps and len(line.moments) else []
        taken_out += [(before + shift, after + shift) for before, after in cuts(bag)]
        steps.append(_Step.of(bag, extent, line, shift, log_shift, number))
        number += max((event["episode"] for event in steps[-1].events), default=-1) + 1
    with whole(output, {**shared, CUTS: json.dumps(taken_out)}, overwrite, bags) as writer:
        for place, step in enumerate(steps):
            step.write(writer, report, with_descriptions=not place)
        return int(writer.counts.total())


class _Extent(NamedTuple):
    """First and last moment of a bag, log times of its first and last message (ns)."""

    first: int
    last: int
    first_log: int
    last_log: int


def _extent(bag: Bag) -> _Extent:
    each = next(dated(bag))
    first, last, first_log = each.moment, each.moment, each.message.log_time
    for each in dated(bag):
        first, last = min(first, each.moment), max(last, each.moment)
    return _Extent(first, last, first_log, each.message.log_time)


class _Step(NamedTuple):
    """One recording to be merged; its own times, and by how much they move (ns)."""

    bag: Bag
    events: list[dict[str, Any]]
    shift: int
    log_shift: int
    number: int
    last: int
    last_log: int
    last_tick: int

    @staticmethod
    def of(bag: Bag, extent: _Extent, line: Timeline, shift: int, log_shift: int, number: int) -> "_Step":
        told = events(bag) or [event for episode in episodes(bag, line) for event in _told(episode)]
        last = extent.last + shift
        last_tick = int(line.moments[-1]) + shift if len(line.moments) else last
        return _Step(bag, told, shift, log_shift, number, last, extent.last_log + log_shift, last_tick)

    def write(self, writer: BagWriter, report: Report, *, with_descriptions: bool) -> None:
        for place, (name, _, message) in enumerate(dated(self.bag)):
            log_time = message.log_time + self.log_shift
            for event in self.events if not place else []:
                moved_on = {"episode": event["episode"] + self.number, "stamp": event["stamp"] + self.shift}
                writer.write(EPISODE_EVENTS, Text(json.dumps({**event, **moved_on})), log_time)
            report(1)
            if name == EPISODE_EVENTS.name or (name in DESCRIPTIONS and not with_descriptions):
                continue
            data = moved(name, message.topic.type, message.data, self.shift)
            writer.copy(message.topic, data, log_time, message.publish_time)


def _told(episode: Episode) -> Iterator[dict[str, Any]]:
    said = {"operator": episode.operator, "outcome": episode.outcome}
    yield {"event": "start", "episode": episode.number, "stamp": episode.first, **said}
    yield {"event": "stop", "episode": episode.number, "stamp": episode.last, **said}


def _require_fit(first: Bag, other: Bag) -> None:
    for what in ("task", "robot_description", "namespace"):
        if getattr(first, what) != getattr(other, what):
            raise BagError(f"{first.path} and {other.path} differ in their {what}", "recordings of one robot and task")
    if fallen_back(other.joints(JOINT_STATES).stamps).any():
        remedy = f"take its parts with: {command('demos', 'trim', other.path)} --from S --to S --output PART"
        raise BagError(f"the stamps of {other.path} fall back", "stamps that only grow", remedy)
