"""All messages of a bag as they lie in it, serialized, in the order of their log times."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray
from rled_msgs_py.bags.folder import open_files
from rled_msgs_py.bags.storage import BagTopic
from rled_msgs_py.bags.stream import stream
from rled_msgs_py.errors import RledError
from rled_msgs_py.topics import Qos


class Recording(NamedTuple):
    """What a bag holds, k messages.

    Attributes:
        topics: of the messages.
        times: log times (ns), ascending, shape (k,).
        topic: place in ``topics`` of each message's topic.
        data: serialized messages.
    """

    topics: list[BagTopic]
    times: NDArray[np.int64]
    topic: list[int]
    data: list[bytes]

    def between(self, start: float, stop: float) -> "Recording":
        """The messages from ``start`` to ``stop`` seconds after the first; a ``stop`` of 0 is the end."""
        seconds = (self.times - self.times[0]) * 1e-9
        chosen = np.flatnonzero((seconds >= start) & ((seconds <= stop) | (stop == 0.0)))
        return self._part(chosen)

    def latched_before(self, start: float) -> "Recording":
        """The newest message before ``start`` seconds of each topic that late joiners are handed one message of."""
        latched = [place for place, each in enumerate(self.topics) if is_latched(quality(each))]
        newest = dict[int, int]()
        for number, place in enumerate(self.topic):
            if place in latched and (self.times[number] - self.times[0]) * 1e-9 < start:
                newest[place] = number
        return self._part(np.array(sorted(newest.values()), dtype=np.int64))

    def _part(self, chosen: NDArray[np.int64]) -> "Recording":
        places = chosen.tolist()
        return Recording(
            self.topics, self.times[chosen], [self.topic[k] for k in places], [self.data[k] for k in places]
        )


def read_recording(path: Path) -> Recording:
    """Read a bag's messages.

    Raises:
        BagError: the bag is missing, unfinished, damaged or foreign.
        RledError: it is empty.
    """
    files, _ = open_files(path)
    messages, places = list(stream(files)), dict[BagTopic, int]()
    if not messages:
        raise RledError(f"{path} holds no messages", "a recorded bag", "record it again")
    topic = [places.setdefault(each.topic, len(places)) for each in messages]
    times = np.array([each.log_time for each in messages], np.int64)
    return Recording([*places], times, topic, [each.data for each in messages])


def is_latched(qos: Qos) -> bool:
    """Whether one message, the newest, is what a late joiner needs."""
    return qos.durability == "transient_local" and qos.depth == 1


def quality(topic: BagTopic) -> Qos:
    """The quality of service that a topic was published with; the default where the bag does not say."""
    try:
        profile = yaml.safe_load(topic.qos)[0]
        return Qos(
            max(1, int(profile["depth"])),
            "best_effort" if profile["reliability"] in ("best_effort", 2) else "reliable",
            "transient_local" if profile["durability"] in ("transient_local", 1) else "volatile",
        )
    except (yaml.YAMLError, LookupError, TypeError, ValueError):
        return Qos(depth=10)
