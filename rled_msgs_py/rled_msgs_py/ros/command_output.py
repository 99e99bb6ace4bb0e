"""Commands that reach the robot although DDS matches a writer and a reader at different times."""

from dataclasses import replace
from typing import Any

from rclpy.node import Node

from rled_msgs_py.messages import encode
from rled_msgs_py.records import DeltaCommand
from rled_msgs_py.ros.callbacks import publisher_events
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.topics import JOINT_DELTA, Topic

HISTORY = 100
"""Commands kept for a recorder that has not acknowledged them; the simulation's reader takes the newest only."""


class CommandOutput:
    """Publishes displacements, and gives the one that still waits for its tick again to a reader that is matched late.

    A node may receive states before its own writer knows the simulation's reader. What it answers then goes nowhere,
    and in lockstep the simulation would wait for ever.

    Args:
        node: whose publisher it is.
        topic: ``joint_delta``, or ``human/joint_delta`` beside an agent.
    """

    def __init__(self, node: Node, topic: Topic = JOINT_DELTA) -> None:
        self._topic = topic
        self._waiting: bytes | None = None
        self._told = 0  # readers that know it, or more when some have left
        matched = publisher_events(node, matched=self._on_matched)
        kind, qos = MESSAGE_CLASSES[topic.type], qos_profile(replace(topic.qos, depth=HISTORY))
        self.publisher = node.create_publisher(kind, topic.name, qos, event_callbacks=matched)

    def publish(self, command: DeltaCommand) -> None:
        """Publish a command, which then waits for its tick."""
        self._waiting = encode(self._topic, command)
        self._told = self.publisher.get_subscription_count()
        self.publisher.publish(self._waiting)

    def withdraw(self) -> None:
        """A newer tick is there: nothing waits any more."""
        self._waiting = None

    def _on_matched(self, change: Any) -> None:
        came = change.total_count_change > 0
        left = change.current_count_change < change.total_count_change  # so that who came may stand in their place
        if self._waiting is not None and came and (left or change.current_count > self._told):
            self.publisher.publish(self._waiting)
        self._told = change.current_count
