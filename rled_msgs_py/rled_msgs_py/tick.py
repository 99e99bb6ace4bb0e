"""One tick of the graph: the state records that share a stamp, put together as they arrive."""

from typing import NamedTuple

from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.topics import EE_POSE, JOINT_STATES, TARGET_POSE, TASK_STATUS

STATE_TOPICS = (JOINT_STATES, EE_POSE, TARGET_POSE, TASK_STATUS)
STATE_NAMES = tuple(topic.name for topic in STATE_TOPICS)
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

    def ordered(self, names: tuple[str, ...]) -> "Tick":
        """The same tick with its joints in the order of ``names``.

        Raises:
            ContractError: a joint is missing or unknown.
        """
        return self._replace(joints=self.joints.ordered(names))


class TickAssembler:
    """Puts the records of one stamp together, whatever the order of their topics.

    A tick is given out once; what is older than the newest tick given out is dropped. Within one run of the simulation
    the stamps of a topic only grow (a reliable topic keeps its order), so a stamp that does not grow is the first of a
    restarted simulation: what waits is forgotten, and ticks are given out from the first stamp again.
    """

    def __init__(self) -> None:
        self._parts: dict[int, dict[str, StateRecord]] = {}
        self._last: dict[str, int] = {}
        self._newest = -1
        self._in_this_run = set(STATE_NAMES)

    def add(self, topic: str, record: StateRecord) -> Tick | None:
        """Take one record; return the tick that it completes, if it does."""
        if record.stamp <= self._last.get(topic, -1):
            self._restart(topic)
        self._last[topic] = record.stamp
        if record.stamp <= self._newest:
            return None
        parts = self._parts.setdefault(record.stamp, {})
        parts[topic] = record
        if len(parts) == len(STATE_NAMES):
            return self._give_out(record.stamp)
        if len(self._parts) > MOST_WAITING:
            del self._parts[next(iter(self._parts))]
        return None

    def _give_out(self, stamp: int) -> Tick:
        parts = self._parts[stamp]
        self._newest = stamp
        self._parts = {later: rest for later, rest in self._parts.items() if later > stamp}
        self._in_this_run = set(STATE_NAMES)
        return Tick(*(parts[name] for name in STATE_NAMES))  # type: ignore[arg-type]

    def _restart(self, topic: str) -> None:
        if topic in self._in_this_run:
            self._parts.clear()
            self._newest = -1
            self._in_this_run = {topic}
        else:  # another topic brought the news; what this one said since is of the old run still
            for parts in self._parts.values():
                parts.pop(topic, None)
            self._in_this_run.add(topic)
