"""Nodes say what they wait for, and what would bring it."""

import time
from collections.abc import Callable

from rclpy.node import Node

from rled_msgs_py.lasting import Waiting
from rled_msgs_py.ros.callbacks import every

LOOK = 0.25
"""Seconds between two looks at what is waited for."""


def say_what_is_awaited(node: Node, awaited: Callable[[], str]) -> None:
    """Log what a node waits for, when it has waited for a moment, and again now and then.

    Args:
        node: logs it.
        awaited: what is waited for now and what would bring it, "joint_states: start sim_node"; empty when nothing is.
    """
    waiting = Waiting()

    def look() -> None:
        text = awaited()
        if waiting.is_due(text, time.monotonic()):
            node.get_logger().info(f"waiting for {text}")

    every(node, LOOK, look)


def brought_by(node: Node, program: str, what: str) -> str:
    """What is awaited, and the program that brings it, in this node's graph: ``awaited`` for the one above."""
    namespace = node.get_namespace()
    within = "" if namespace == "/" else f", namespace {namespace}"
    return f"{what}: start {program} in ROS_DOMAIN_ID {node.context.get_domain_id()}{within}"
