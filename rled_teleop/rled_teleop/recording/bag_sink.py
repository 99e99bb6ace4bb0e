"""Received messages written into a bag: safe at once, written when their place among the others is known."""

import time
from collections.abc import Callable, Sequence

from rled_msgs_py.bags import BagWriter
from rled_msgs_py.bags.header import sim_stamp
from rled_msgs_py.topics import Topic

from rled_teleop.recording.reorder_buffer import Received, ReorderBuffer

WRITE_PERIOD = 0.05
"""Seconds between writes; for the sake of their order messages are held for two of them."""


class BagSink:
    """Files messages in a bag.

    Args:
        bag: open for writing.
        topics: in the order of their messages at one stamp.

    Attributes:
        kept: messages that are safe.

    Raises:
        BagError: (from the methods) the bag cannot be written.
    """

    def __init__(self, bag: BagWriter, topics: Sequence[Topic]) -> None:
        self._bag = bag
        self._ranks = {topic.name: rank for rank, topic in enumerate(topics)}
        self._buffer = ReorderBuffer()
        self._written_at = time.monotonic()
        self.kept = 0

    def keep(self, topic: Topic, data: bytes) -> int:
        """Make a message safe; returns its number, for ``add`` or ``forget``."""
        stamp = sim_stamp(topic.name, topic.type, data)
        self.kept += 1
        return self._bag.keep(topic, data, (self._buffer.newest or 0) if stamp is None else stamp)

    def add(self, topic: Topic, data: bytes, number: int) -> None:
        """Let a message that is kept find its place."""
        self._buffer.add(topic, self._ranks[topic.name], data, number)

    def take(self, topic: Topic, data: bytes) -> None:
        """Keep a message and let it find its place."""
        self.add(topic, data, self.keep(topic, data))

    def forget(self, number: int) -> None:
        """A message that is kept does not belong into the bag."""
        self._bag.forget(number)

    def write_when_due(self) -> None:
        """Write what is ripe, if it is time to."""
        if (now := time.monotonic()) - self._written_at >= WRITE_PERIOD:
            self._written_at = now
            self._write(self._buffer.due())

    def write_rest(self, belongs: Callable[[Received], bool]) -> None:
        """Write what is still held and belongs into the bag."""
        self._write([each for each in self._buffer.rest() if belongs(each)])

    def _write(self, messages: list[Received]) -> None:
        for each in messages:
            self._bag.write_cdr(each.topic, each.data, each.stamp, number=each.number)
