"""A recording looked through as a whole: its rows, episodes, their quality, and its faults."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.episodes import Episode, cuts, episodes
from rled_msgs_py.bags.faults import Fault, find_faults
from rled_msgs_py.bags.quality import Quality, qualities
from rled_msgs_py.bags.series import Series, series
from rled_msgs_py.bags.timeline import Timeline, read_series, read_timeline
from rled_msgs_py.messages import NANOSECONDS
from rled_msgs_py.topics import JOINT_STATES, MARKED_EE_POSE, MARKED_JOINT_STATES

MARKED = (MARKED_JOINT_STATES, MARKED_EE_POSE)


class Review(NamedTuple):
    """What a recording holds and what it is worth.

    Attributes:
        series: its topics by name.
        timeline: its ticks.
        episodes: in order, discarded ones too.
        qualities: of each episode.
        faults: in order.
        period: simulation time between ticks (ns).
    """

    series: dict[str, Series]
    timeline: Timeline
    episodes: list[Episode]
    qualities: list[Quality]
    faults: list[Fault]
    period: int

    @property
    def begin(self) -> int:
        """Moment of the first message that has one (ns)."""
        return min((int(each.moments[0]) for each in self.series.values() if len(each.moments)), default=0)

    def seconds(self, moment: int) -> float:
        """Time since the first state, as ``trim`` counts it (s)."""
        states = self.series[JOINT_STATES.name].moments
        return (moment - int(states[0] if len(states) else self.begin)) / NANOSECONDS

    def episodes_of(self, fault: Fault) -> list[int]:
        """Numbers of the episodes that a fault lies in."""
        return [each.number for each in self.episodes if each.first <= fault.last and fault.first < each.last]


def review(bag: Bag) -> Review:
    """Look a recording through.

    Raises:
        BagError: the file is damaged, or there is no description of the task.
        ContractError: a joint of the task is in no message.
    """
    task = bag.task
    found = read_series(bag)
    timeline = read_timeline(bag, found)
    divided = episodes(bag, timeline)
    found |= {topic.name: series(bag, topic) for topic in MARKED}
    faults = find_faults(found, [*cuts(bag), *pauses(divided, timeline)], task.period)
    return Review(found, timeline, divided, qualities(task, timeline, divided), faults, task.period)


def pauses(divided: list[Episode], timeline: Timeline) -> list[tuple[int, int]]:
    """Where the recorder waited between two episodes: the last moment before and the first after (ns)."""
    found = []
    for before, after in pairwise(divided):
        row = int(np.searchsorted(timeline.moments, before.last, side="right"))
        if row < len(timeline.moments) and timeline.moments[row] >= after.first:
            found.append((before.last, int(timeline.moments[row])))
    return found
