"""The newest messages of each topic."""

from collections import defaultdict, deque
from collections.abc import Iterable
from contextlib import suppress
from typing import cast

from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.errors import ContractError
from rled_msgs_py.joint_merger import JointMerger
from rled_msgs_py.messages import decode, encode
from rled_msgs_py.records import JointSample
from rled_msgs_py.topics import EE_POSE, JOINT_STATES, Topic

MAX_KEPT = 8
"""Joint states and poses that are kept: they may be some ticks apart. Of the other topics it is one."""


class RecentMessages:
    """Keeps the newest serialized messages of each topic."""

    def __init__(self) -> None:
        self._messages: defaultdict[Topic, deque[bytes]] = defaultdict(lambda: deque(maxlen=1))
        self._messages |= {topic: deque(maxlen=MAX_KEPT) for topic in (JOINT_STATES, EE_POSE)}

    def add(self, topic: Topic, data: bytes) -> None:
        """Take a message."""
        self._messages[topic].append(data)

    def newest(self, topic: Topic) -> bytes | None:
        """The newest message of a topic."""
        return self._messages[topic][-1] if self._messages[topic] else None

    def stamp(self, topic: Topic) -> int:
        """Stamp of the newest message of a topic (ns), -1 when there is none."""
        newest = self.newest(topic)
        return -1 if newest is None else stamp_of(topic.type, newest) or 0

    def stamps(self, topics: Iterable[Topic]) -> list[int]:
        """The same of several topics."""
        return [self.stamp(topic) for topic in topics]

    def pose(self, joints: tuple[str, ...]) -> tuple[bytes, bytes] | None:
        """Joint state and end-effector pose of the newest stamp at which the joints are known, all of them.

        Samples that name some of the joints only are put together; one that names all is handed out as received.
        """
        whole, halves = dict[int, bytes](), JointMerger(joints)
        for data in self._messages[JOINT_STATES]:
            with suppress(ContractError):  # it says nothing of the robot's joints
                sample = cast(JointSample, decode(JOINT_STATES, data))
                halves.add(sample)
                whole[sample.ordered(joints).stamp] = data
        for data in reversed(self._messages[EE_POSE]):
            stamp = stamp_of(EE_POSE.type, data)
            known = None if stamp is None else halves.at(stamp)
            if known is not None:
                return whole.get(known.stamp) or encode(JOINT_STATES, known), data
        return None
