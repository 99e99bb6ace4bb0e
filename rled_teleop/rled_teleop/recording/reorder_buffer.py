"""The order of messages in a bag: by stamp, then by topic, whatever order they were delivered in."""

from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeVar

from rled_msgs_py.bags.header import sim_stamp
from rled_msgs_py.topics import Topic

T = TypeVar("T")


class Received(NamedTuple):
    """A serialized message with its place in the order.

    Attributes:
        stamp: simulation time that it is filed under (ns).
        rank: place of its topic among the topics of one stamp.
        number: running number of reception, under which the bag keeps it.
        topic: where it came from.
        data: the message as received, CDR with its four-byte header.
    """

    stamp: int
    rank: int
    number: int
    topic: Topic
    data: bytes


class ReorderBuffer:
    """Holds messages for a moment, so that those of one stamp are written in a fixed order of topics.

    DDS keeps order within a topic only. ``due`` is called at a fixed rate and hands out everything up to the newest
    stamp that was there at the call before it, and all that was there itself: a message waits at most two calls, also
    when stamps go back (latched topics hand a late joiner their history one after another). What has no stamp waits
    for the first stamp, and is filed under the newest one.

    Attributes:
        newest: the stamp received last (ns), None before the first.
    """

    def __init__(self) -> None:
        self._held: list[Received] = []
        self._unstamped: list[Received] = []
        self.newest: int | None = None
        self._ripe: int | None = None
        self._next = self._waiting = 0

    def add(self, topic: Topic, rank: int, data: bytes, number: int) -> None:
        """Take a message as received."""
        stamp = sim_stamp(topic.name, topic.type, data)
        if stamp is not None:
            self.newest = stamp
            self._held += [each._replace(stamp=stamp) for each in self._unstamped]
            self._unstamped.clear()
        filed = self._newest_for(topic) if stamp is None else stamp
        held = self._unstamped if filed is None else self._held
        held.append(Received(filed or 0, rank, number, topic, data))
        self._next = max(self._next, number + 1)

    def _newest_for(self, topic: Topic) -> int | None:
        """Where a message without a stamp belongs: the newest stamp may be of a late one, its topic keeps its order."""
        held = (each.stamp for each in self._held if each.topic == topic)
        return self.newest if self.newest is None else max([self.newest, *held])

    def due(self) -> list[Received]:
        """What is ripe to be written, in order."""
        ripe, self._ripe = self._ripe, self.newest
        waited, self._waiting = self._waiting, self._next
        if ripe is None:
            return []
        written, self._held = partition(self._held, lambda each: each.stamp <= ripe or each.number < waited)
        return sorted(written)

    def rest(self) -> list[Received]:
        """Everything still held, in order."""
        rest, self._held, self._unstamped = sorted([*self._held, *self._unstamped]), [], []
        return rest


def partition(messages: Iterable[T], chosen: Callable[[T], bool]) -> tuple[list[T], list[T]]:
    """The messages that are chosen, and the others, both in their order."""
    parts: tuple[list[T], list[T]] = [], []
    for each in messages:
        parts[not chosen(each)].append(each)
    return parts
