"""One tick of the graph: the state records that share a stamp, put together as they arrive."""

from typing import NamedTuple

from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.topics import EE_POSE, JOINT_STATES, TARGET_POSE, TASK_STATUS

STATE_TOPICS = (JOINT_STATES, EE_POSE, TARGET_POSE, TASK_STATUS)
StateRecord = JointSample | PoseSample | TaskStatus

MOST_WAITING = 100
"""Incomplete ticks that are kept; the latched topics hand a late joiner 10 at once."""


class Tick(NamedTuple):
    """What the simulation says at one stamp."""

    joints: JointSample
    ee: PoseSample
    target: PoseSample
    status: TaskStatus

    @property
    def stamp(self) -> int:
        """Simulation time (ns)."""
        return self.joints.stamp


class TickAssembler:
    """Puts the records of one stamp together, whatever the order of their topics.

    A tick is given out once; what is older than the newest tick given out is dropped. Within one run of the simulation
    the stamps of a topic only grow (a reliable topic keeps its order), so a stamp that does not grow is the first of a
    restarted simulation: from it on, ticks are given out again, and what that topic said of the old run is forgotten.
    """

    def __init__(self) -> None:
        self._parts: dict[int, dict[str, StateRecord]] = {}
        self._last: dict[str, int] = {}
        self._newest = -1

    def add(self, topic: str, record: StateRecord) -> Tick | None:
        """Take one record; return the tick that it completes, if it does."""
        if record.stamp <= self._last.get(topic, -1):
            self._restart(topic, record.stamp)
        self._last[topic] = record.stamp
        if record.stamp <= self._newest:
            return None
        parts = self._parts.setdefault(record.stamp, {})
        parts[topic] = record
        if len(parts) < len(STATE_TOPICS):
            self._drop_oldest()
            return None
        self._newest = record.stamp
        self._parts = {stamp: rest for stamp, rest in self._parts.items() if stamp > self._newest}
        return Tick(*(parts[topic.name] for topic in STATE_TOPICS))  # type: ignore[arg-type]

    def _restart(self, topic: str, stamp: int) -> None:
        self._newest = min(self._newest, stamp - 1)
        for waiting, parts in self._parts.items():
            if waiting >= stamp:
                parts.pop(topic, None)

    def _drop_oldest(self) -> None:
        if len(self._parts) > MOST_WAITING:
            del self._parts[next(iter(self._parts))]
