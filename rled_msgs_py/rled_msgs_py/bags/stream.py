"""The messages of a bag's files one after the other, without holding them in memory."""

from collections.abc import Callable, Collection, Iterator, Sequence
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from rled_msgs_py.bags.columns import payloads
from rled_msgs_py.bags.storage import BagTopic, Messages, Storage

Choice = Callable[[BagTopic], bool]


class Message(NamedTuple):
    """A serialized message, as it lies in a bag.

    Attributes:
        topic: its topic as the bag describes it.
        log_time: time of its arrival (ns).
        publish_time: time of its sending (ns).
        data: the message (CDR).
    """

    topic: BagTopic
    log_time: int
    publish_time: int
    data: bytes


def stream(files: Sequence[Storage], is_wanted: Choice = lambda topic: True) -> Iterator[Message]:
    """The messages of some topics in the order of their log times.

    Files are read twice: whoever wrote them nearly always wrote in this order, and otherwise all are held to be sorted.

    Raises:
        BagError: a file is damaged.
    """
    chosen = [(file, [channel for channel, topic in file.topics.items() if is_wanted(topic)]) for file in files]
    if _is_in_order(chosen):
        yield from _as_written(chosen)
    else:
        yield from sorted(_as_written(chosen), key=attrgetter("log_time"))


def _runs(chosen: Sequence[tuple[Storage, Collection[int]]]) -> Iterator[tuple[Storage, Messages]]:
    for file, channels in chosen:
        for run in file.messages(channels):
            yield file, run


def _is_in_order(chosen: Sequence[tuple[Storage, Collection[int]]]) -> bool:
    newest = 0
    for _, run in _runs(chosen):
        if (np.diff(run.log_time, prepend=newest) < 0).any():
            return False
        newest = max(newest, *run.log_time[-1:].tolist())
    return True


def _as_written(chosen: Sequence[tuple[Storage, Collection[int]]]) -> Iterator[Message]:
    for file, run in _runs(chosen):
        numbers = (run.channel.tolist(), run.log_time.tolist(), run.publish_time.tolist())
        for channel, log_time, publish_time, data in zip(*numbers, payloads(run), strict=True):
            yield Message(file.topics[channel], log_time, publish_time, data)
