"""The order of messages in a bag: by stamp, then by topic, whatever order they were delivered in."""

from collections.abc import Callable
from typing import NamedTuple

from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.topics import Topic


class Received(NamedTuple):
    """A serialized message with its place in the order.

    Attributes:
        stamp: simulation time that it is filed under (ns).
        rank: place of its topic among the topics of one stamp.
        number: running number of reception.
        topic: where it came from.
        data: the message as received, CDR with its four-byte header.
    """

    stamp: int
    rank: int
    number: int
    topic: Topic
    data: bytes


class Ordering:
    """Holds messages for a moment, so that those of one stamp are written in a fixed order of topics.

    DDS keeps order within a topic only. ``due`` is called at a fixed rate and hands out everything up to the newest
    stamp that was there at the call before it, and all that was there itself: a message waits at most two calls, also
    when stamps go back (latched topics hand a late joiner their history one after another). What has no stamp waits
    for the first stamp, and is filed under the newest one.
    """

    def __init__(self) -> None:
        self._held: list[Received] = []
        self._unstamped: list[tuple[int, Topic, bytes]] = []
        self._newest: int | None = None
        self._ripe: int | None = None
        self._count = self._waiting = 0

    def add(self, topic: Topic, rank: int, data: bytes) -> None:
        """Take a message as received."""
        stamp = stamp_of(topic.type, data)
        if stamp is not None:
            self._newest = stamp
            for rank_, topic_, data_ in self._unstamped:
                self._hold(stamp, rank_, topic_, data_)
            self._unstamped.clear()
        if self._newest is None:
            self._unstamped.append((rank, topic, data))
        else:
            self._hold(self._newest if stamp is None else stamp, rank, topic, data)

    def due(self) -> list[Received]:
        """What is ripe to be written, in order."""
        ripe, self._ripe = self._ripe, self._newest
        waited, self._waiting = self._waiting, self._count
        if ripe is None:
            return []
        written, self._held = partition(self._held, lambda each: each.stamp <= ripe or each.number < waited)
        return sorted(written)

    def rest(self) -> list[Received]:
        """Everything still held, in order."""
        for rank, topic, data in self._unstamped:
            self._hold(self._newest or 0, rank, topic, data)
        rest, self._held, self._unstamped = sorted(self._held), [], []
        return rest

    def _hold(self, stamp: int, rank: int, topic: Topic, data: bytes) -> None:
        self._held.append(Received(stamp, rank, self._count, topic, data))
        self._count += 1


def partition(messages: list[Received], chosen: Callable[[Received], bool]) -> tuple[list[Received], list[Received]]:
    """The messages that are chosen, and the others, both in their order."""
    parts: tuple[list[Received], list[Received]] = [], []
    for each in messages:
        parts[not chosen(each)].append(each)
    return parts
