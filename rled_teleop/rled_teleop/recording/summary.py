"""What a recording holds, read back from its bag."""

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rled_msgs_py.bags import Bag
from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import JOINT_DELTA, JOINT_STATES, MARKED_JOINT_STATES, TASK_STATUS

from rled_teleop.recording.episode_events import EPISODE, REACHED, count_of


class Summary(NamedTuple):
    """What a recording holds.

    Attributes:
        path: the bag.
        messages: on all topics.
        points: marked, ζᵃ.
        trajectories: targets reached after the last mark, ζᵇ.
        states: ticks.
        unanswered: ticks but the last that no delta answers.
        lost: messages that must have been there: parts of a tick, or the state that a delta answers.
        seconds: of simulation time.
    """

    path: Path
    messages: int
    points: int
    trajectories: int
    states: int
    unanswered: int
    lost: int
    seconds: float

    def __str__(self) -> str:
        answers = f" ({self.unanswered} without an answer)" if self.unanswered else ""
        lost = f"; {self.lost} MESSAGES WERE LOST" if self.lost else ""
        points, states = counted(self.points, "point"), counted(self.states, "state")
        trajectories = counted(self.trajectories, "trajectory", "trajectories")
        parts = f"{counted(self.messages, 'message')}, {points}, {trajectories}, {states}{answers}"
        return f"{self.path}: {parts}, {self.seconds:.2f} s of simulation{lost}"


def counted(number: int, one: str, many: str = "") -> str:
    """A number with its noun: 1 episode, 2 episodes."""
    return f"{number} {one if number == 1 else many or f'{one}s'}"


def summarise(path: Path) -> Summary:
    """Read a bag and sum it up.

    Raises:
        BagError: it cannot be read.
    """
    bag = Bag(path)
    states, deltas = bag.joints(JOINT_STATES).stamps, bag.joints(JOINT_DELTA).stamps
    marks = bag.joints(MARKED_JOINT_STATES).stamps
    return Summary(
        path=path,
        messages=bag.message_count,
        points=len(marks),
        trajectories=_targets_reached(bag, int(marks[-1]) if len(marks) else -1),
        states=len(states),
        unanswered=int((~np.isin(states[:-1], deltas)).sum()),
        lost=_parts_missing(bag) + int((~np.isin(deltas, states)).sum()),
        seconds=float(states[-1] - states[0]) * 1e-9 if len(states) else 0.0,
    )


def _parts_missing(bag: Bag) -> int:
    parts = [bag.counts[topic.name] for topic in STATE_TOPICS]
    return max(parts) * len(parts) - sum(parts)


def _targets_reached(bag: Bag, after: int) -> int:
    """Targets reached after a stamp (ns), over all episodes."""
    counts = (
        (count_of(EPISODE, each.data), count_of(REACHED, each.data) or 0)
        for each in bag.messages(TASK_STATUS)
        if (stamp_of(each.topic.type, each.data) or 0) >= after
    )
    return sum(max(0, now - before) for (episode, before), (same, now) in pairwise(counts) if episode == same)
