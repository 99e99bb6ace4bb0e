"""All messages of a bag as they lie in it, serialized, in the order of their log times."""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.bags.folder import open_files
from rled_msgs_py.bags.metadata import offered
from rled_msgs_py.bags.storage import BagTopic
from rled_msgs_py.bags.stream import stream
from rled_msgs_py.errors import RledError
from rled_msgs_py.topics import Qos

MAX_DEPTH = 10_000
"""Messages that are kept for slow readers at the most; DDS makes room for them."""
_MESSAGE_TYPE = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")


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
        RledError: it holds no messages of ROS.
    """
    files, _ = open_files(path)
    messages, places = list(stream(files, is_of_ros)), dict[BagTopic, int]()
    if not messages:
        raise RledError(f"{path} holds no messages", "a recorded bag", "record it again")
    topic = [places.setdefault(each.topic, len(places)) for each in messages]
    times = np.array([each.log_time for each in messages], np.int64)
    return Recording([*places], times, topic, [each.data for each in messages])


def is_of_ros(topic: BagTopic) -> bool:
    """Whether a topic can travel over ROS; bags have others too, as in JSON."""
    return topic.encoding == "cdr" and bool(_MESSAGE_TYPE.fullmatch(topic.type))


def is_latched(qos: Qos) -> bool:
    """Whether one message, the newest, is what a late joiner needs."""
    return qos.durability == "transient_local" and qos.depth == 1


def quality(topic: BagTopic) -> Qos:
    """The quality of service that a topic was published with; what the bag does not say is the default."""
    profile = next(iter(offered(topic.qos)), {})
    depth = profile.get("depth")
    if type(depth) is not int or not {"reliability", "durability"} <= profile.keys():
        return Qos(depth=10)
    return Qos(
        min(max(1, depth), MAX_DEPTH),
        "best_effort" if profile["reliability"] in ("best_effort", 2) else "reliable",
        "transient_local" if profile["durability"] in ("transient_local", 1) else "volatile",
    )
