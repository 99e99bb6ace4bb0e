"""Events of the quality of service: whether another node lives, and whether a topic keeps its pace.

Who offers a lease or a deadline still matches every reader that asks for none: tools, and nodes older than this.
"""

import time
from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from rled_msgs_py.debounce import Debounce
from rled_msgs_py.ros.callbacks import every, listen, publisher_events, subscription_events
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.topics import Topic

FOREVER = Duration(seconds=10**6)
"""Longer than any deadline that is one."""
LEASE = 1.0
"""Seconds without a sign of life after which a node counts as gone, and that it has to stay so before it is told."""
POLL_PERIOD = 0.1
"""Seconds between two polls of what has lasted."""


def offer_liveliness(node: Node, topic: Topic) -> Publisher:
    """A publisher whose node can be watched with ``watch_liveliness``; the middleware asserts it by itself."""
    return node.create_publisher(MESSAGE_CLASSES[topic.type], topic.name, _leased(topic))


def watch_liveliness(node: Node, topic: Topic, changed: Callable[[bool], None]) -> Subscription:
    """Call ``changed`` with whether a publisher lives, when that changes and lasts.

    On a busy machine a sign of life comes late now and then: who was gone for two milliseconds was not gone.

    This reader is one of its own beside the one that takes the messages, since it does not match a publisher that
    offers no lease: a replayed bag.
    """
    steady = Debounce(LEASE, changed)
    every(node, POLL_PERIOD, lambda: steady.poll(time.monotonic()))

    def on_change(status: Any) -> None:
        steady.see(status.alive_count > 0, time.monotonic())

    events = subscription_events(node, liveliness=on_change, incompatible_qos=lambda status: None)
    return listen(node, MESSAGE_CLASSES[topic.type], topic.name, _leased(topic), lambda data: None, events=events)


def _leased(topic: Topic) -> Any:
    profile = qos_profile(topic.qos)
    profile.liveliness_lease_duration = Duration(seconds=LEASE)
    return profile


def has_deadline(node: Node, topic: Topic) -> bool | None:
    """Whether a publisher of a topic promises messages at a pace of its own; None when no publisher is known."""
    found = node.get_publishers_info_by_topic(topic.name)
    return any(each.qos_profile.deadline < FOREVER for each in found) if found else None


def advertise_with_deadline(node: Node, topic: Topic, deadline: float, missed: Callable[[int], None]) -> Publisher:
    """A publisher that promises a message every ``deadline`` seconds, and counts where it broke the promise.

    Args:
        node: the node.
        topic: the topic.
        deadline: longest time between two messages (s).
        missed: called with the number of deadlines missed since its last call.
    """

    def on_miss(status: Any) -> None:
        missed(status.total_count_change)

    profile = qos_profile(topic.qos)
    profile.deadline = Duration(seconds=deadline)
    events = publisher_events(node, deadline=on_miss)
    return node.create_publisher(MESSAGE_CLASSES[topic.type], topic.name, profile, event_callbacks=events)
