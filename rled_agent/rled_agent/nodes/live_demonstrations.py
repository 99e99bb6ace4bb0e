"""Demonstrations received from the topics while they are made or played back, kept as a bag like any other."""

import time
from functools import partial
from pathlib import Path
from threading import Event
from typing import NamedTuple

import rclpy
from rclpy.node import Node
from rled_msgs_py.bags import BagWriter
from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.errors import RledError
from rled_msgs_py.messages import require_size
from rled_msgs_py.middleware import return_messages
from rled_msgs_py.ros.callbacks import every, listen
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.ros.node import spin, start_ros
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from rled_msgs_py.stopping import stop_requested
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import JOINT_STATES, RECORDED, Qos, Topic

QUEUE_DEPTH = 10_000
"""Messages of a topic that wait while this process is held up."""
POLL_PERIOD = 0.1
"""Seconds between two looks whether somebody still publishes."""
SILENCE_TIMEOUT = 1.0
"""Seconds without a publisher and without a message after which a demonstration has ended."""


class Heard(NamedTuple):
    """A serialized message with its place in a bag: by stamp, then by topic, then by reception."""

    stamp: int
    rank: int
    number: int
    data: bytes


class LiveDemonstrations(Node):
    """Listens to everything that a demonstration bag holds, ``joint_delta`` last: whoever sees that may begin."""

    def __init__(self) -> None:
        super().__init__("train_expert")
        self._heard: list[Heard] = []
        self._newest, self._last = 0, 0.0
        for rank, topic in enumerate(RECORDED):
            qos = qos_profile(Qos(QUEUE_DEPTH, topic.qos.reliability, topic.qos.durability))
            received = partial(self._on_message, rank, topic)
            listen(self, MESSAGE_CLASSES[topic.type], topic.name, qos, received)

    def end_when_over(self, stop: Event) -> None:
        """Ask for the end when whoever demonstrated has gone."""

        def look() -> None:
            silent = time.monotonic() - self._last > SILENCE_TIMEOUT
            if self._heard and silent and not self.count_publishers(JOINT_STATES.name):
                stop.set()

        every(self, POLL_PERIOD, look)
        publisher = "record_demos with an operator, or replay_demos,"
        report_waiting(self, lambda: "" if self._heard else waiting_for(self, publisher, "a demonstration"))

    def write(self, path: Path) -> int:
        """Write what was heard as a bag; returns how many messages.

        Raises:
            RledError: nothing was heard, or it cannot be written.
        """
        if not self._heard:
            raise RledError("no demonstration was received", "", "is one played in this ROS_DOMAIN_ID?")
        with BagWriter(path, metadata={"source": "topics"}, overwrite=True) as bag:
            for each in sorted(self._heard):
                bag.write_cdr(RECORDED[each.rank], each.data, each.stamp)
            parts = [bag.counts[topic.name] for topic in STATE_TOPICS]
        if missing := max(parts) * len(parts) - sum(parts):
            self.get_logger().warning(f"{missing} messages were not received; their ticks are left out")
        return len(self._heard)

    def _on_message(self, rank: int, topic: Topic, data: bytes) -> None:
        require_size(topic, data)
        stamp = stamp_of(topic.type, data)
        self._newest = self._newest if stamp is None else stamp
        self._last = time.monotonic()
        self._heard.append(Heard(self._newest, rank, len(self._heard), data))


def receive_demonstrations(path: Path) -> int:
    """Listen until whoever demonstrates has gone, or until SIGINT or SIGTERM; keep what was heard as a bag.

    Args:
        path: the bag's folder; one from before is replaced.

    Returns:
        How many messages there were.

    Raises:
        RledError: nothing was heard, or it cannot be written.
    """
    return_messages()
    start_ros()
    try:
        with stop_requested() as stop:
            node = LiveDemonstrations()
            node.end_when_over(stop)
            print("listening to a demonstration; it ends with its publisher, or by Ctrl-C", flush=True)
            spin(node, stop)
        messages = node.write(path)
        node.destroy_node()
        return messages
    finally:
        rclpy.try_shutdown()
