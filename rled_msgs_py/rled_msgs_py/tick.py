"""One tick of the graph: the state records that share a stamp, put together as they arrive."""

from typing import NamedTuple

from rled_msgs_py.joint_merger import JointMerger
from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.topics import EE_POSE, JOINT_STATES, TARGET_POSE, TASK_STATUS

STATE_TOPICS = (JOINT_STATES, EE_POSE, TARGET_POSE, TASK_STATUS)
STATE_NAMES = tuple(topic.name for topic in STATE_TOPICS)
StateRecord = JointSample | PoseSample | TaskStatus
Source = tuple[str, tuple[str, ...]]
"""Topic, and of joint samples the names."""

MAX_WAITING = 100
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
    the stamps of a publisher only grow (a reliable topic keeps its order), so a stamp that does not grow is the first
    of a restarted simulation: what waits is forgotten, and ticks are given out from the first stamp again.

    Once the robot's joints are known (``meet``), other joints are passed over, and samples that name only some of them
    are put together, see ``JointMerger``.
    """

    def __init__(self, names: tuple[str, ...] = ()) -> None:
        self._parts: dict[int, dict[str, StateRecord]] = {}
        self._last: dict[Source, int] = {}
        self._newest = -1
        self._of_old_run = set[Source]()
        self._names, self._halves, self._has_halves = names, JointMerger(names), False

    def meet(self, names: tuple[str, ...]) -> None:
        """Learn which joints are the robot's."""
        if names != self._names:
            self._names, self._halves = names, JointMerger(names)

    def add(self, topic: str, record: StateRecord) -> Tick | None:
        """Take one record; return the tick that it completes, if it does.

        Raises:
            ContractError: a joint of the robot has no finite position.
        """
        named: tuple[str, ...] = ()
        if isinstance(record, JointSample) and self._names:
            named = record.names if record.names == self._names else tuple(n for n in self._names if n in record.names)
            if not named:
                return None
        self._see((topic, named), record.stamp)
        if record.stamp <= self._newest:
            return None
        if isinstance(record, JointSample) and len(named) < len(self._names):
            return self._add_half(record)
        if isinstance(record, JointSample) and named:
            if self._has_halves:
                self._halves.add(record)
            record = record.ordered(named)
        self._wait(record.stamp)[topic] = record
        return self._complete(record.stamp)

    def _add_half(self, half: JointSample) -> Tick | None:
        self._halves.add(half)
        self._has_halves = True
        self._wait(half.stamp)
        ticks = (self._complete(stamp) for stamp in sorted(self._parts, reverse=True))
        return next((tick for tick in ticks if tick is not None), None)

    def _wait(self, stamp: int) -> dict[str, StateRecord]:
        parts = self._parts.setdefault(stamp, {})
        if len(self._parts) > MAX_WAITING:
            del self._parts[next(iter(self._parts))]
        return parts

    def _complete(self, stamp: int) -> Tick | None:
        parts = self._parts[stamp]
        if self._names and len(parts) == len(STATE_NAMES) - 1 and JOINT_STATES.name not in parts:
            joints = self._halves.at(stamp)
            parts |= {} if joints is None else {JOINT_STATES.name: joints}
        return self._give_out(stamp) if len(parts) == len(STATE_NAMES) else None

    def _give_out(self, stamp: int) -> Tick:
        parts = self._parts[stamp]
        self._newest = stamp
        self._parts = {later: rest for later, rest in self._parts.items() if later > stamp}
        self._of_old_run.clear()
        return Tick(*(parts[name] for name in STATE_NAMES))  # type: ignore[arg-type]

    def _see(self, source: Source, stamp: int) -> None:
        """Notice a restart by the stamp of a publisher, told by its topic and the joints that it names."""
        if stamp <= self._last.get(source, -1):
            self._restart(source)
        elif len(self._last) > MAX_WAITING:
            self._last.clear()
        self._last[source] = stamp

    def _restart(self, source: Source) -> None:
        if source not in self._of_old_run:
            self._parts.clear()
            self._halves.clear()
            self._newest = -1
            self._of_old_run = set(self._last) - {source}
        else:  # another topic brought the news; what this one said since is of the old run still
            for parts in self._parts.values():
                parts.pop(source[0], None)
            self._of_old_run.remove(source)
