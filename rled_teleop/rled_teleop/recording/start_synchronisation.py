"""The first messages of a recording: it begins with a tick that is whole."""

import time
from typing import NamedTuple

from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import Topic

from rled_teleop.recording.reorder_buffer import partition

START_TIMEOUT = 0.5
"""Seconds after which a recording begins without the state topics on which nothing comes."""


class EarlyMessage(NamedTuple):
    """A message received before the recording begins.

    Attributes:
        topic: where it came from.
        number: under which the bag keeps it.
        stamp: simulation time (ns).
        data: the message.
    """

    topic: Topic
    number: int
    stamp: int
    data: bytes


class StartSynchronisation:
    """Holds messages until there is one of each state topic.

    A late joiner is handed the last states of each topic, but is matched with one topic after the other: of the first
    ones it may get older states.
    """

    def __init__(self) -> None:
        self._held: list[EarlyMessage] = []
        self._since = 0.0

    def add(self, message: EarlyMessage) -> None:
        """Take a message."""
        if not self._held:
            self._since = time.monotonic()
        self._held.append(message)

    def is_ready(self) -> bool:
        """Whether the recording can begin."""
        if not self._held:
            return False
        heard = {each.topic for each in self._held}
        return heard >= {*STATE_TOPICS} or time.monotonic() - self._since > START_TIMEOUT

    def messages(self) -> tuple[list[EarlyMessage], list[EarlyMessage]]:
        """What belongs to the recording, from the first tick on that all topics have, and what does not."""
        first: dict[Topic, int] = {}
        for each in self._held:
            first.setdefault(each.topic, each.stamp)
        begin = max((stamp for topic, stamp in first.items() if topic in STATE_TOPICS), default=0)
        return partition(self._held, lambda each: each.stamp >= begin)
