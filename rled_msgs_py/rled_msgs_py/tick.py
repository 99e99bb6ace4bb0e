"""One tick of the graph: the state records that share a stamp, put together as they arrive."""

from typing import NamedTuple

from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.topics import EE_POSE, JOINT_STATES, TARGET_POSE, TASK_STATUS

STATE_TOPICS = (JOINT_STATES, EE_POSE, TARGET_POSE, TASK_STATUS)


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

    A tick is given out once; what is older than the newest tick given out is dropped.
    """

    def __init__(self) -> None:
        self._parts: dict[int, dict[str, JointSample | PoseSample | TaskStatus]] = {}
        self._newest = -1

    def add(self, topic: str, record: JointSample | PoseSample | TaskStatus) -> Tick | None:
        """Take one record; return the tick that it completes, if it does."""
        if record.stamp <= self._newest:
            return None
        parts = self._parts.setdefault(record.stamp, {})
        parts[topic] = record
        if len(parts) < len(STATE_TOPICS):
            return None
        self._newest = record.stamp
        self._parts = {stamp: rest for stamp, rest in self._parts.items() if stamp > self._newest}
        return Tick(*(parts[topic.name] for topic in STATE_TOPICS))  # type: ignore[arg-type]
