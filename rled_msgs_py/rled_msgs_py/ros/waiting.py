"""Nodes say what they wait for, and what would bring it."""

import time
from collections.abc import Callable

from rclpy.node import Node

from rled_msgs_py.debounce import WaitingReport
from rled_msgs_py.ros.callbacks import every

POLL_PERIOD = 0.25
"""Seconds between two polls of what is waited for."""


def report_waiting(node: Node, awaited: Callable[[], str]) -> None:
    """Log what a node waits for, when it has waited for a moment, and again now and then.

    Args:
        node: logs it.
        awaited: what is waited for now and what would bring it, "joint_states: start sim_node"; empty when nothing is.
    """
    waiting = WaitingReport()

    def poll() -> None:
        text = awaited()
        if waiting.is_due(text, time.monotonic()):
            node.get_logger().info(f"waiting for {text}")

    every(node, POLL_PERIOD, poll)


def waiting_for(node: Node, program: str, what: str) -> str:
    """What is awaited, and the program that brings it, in this node's graph: ``awaited`` for the one above."""
    namespace = node.get_namespace()
    within = "" if namespace == "/" else f", namespace {namespace}"
    return f"{what}: start {program} in ROS_DOMAIN_ID {node.context.get_domain_id()}{within}"
