"""Prints when each joint state came and where the joints were: one line of JSON for each."""

import json
import time

from rclpy.node import Node
from rled_msgs_py.records import JointSample
from rled_msgs_py.ros.node import fresh_context, spin, subscribe
from rled_msgs_py.stopping import stop_requested
from rled_msgs_py.topics import JOINT_STATES


def say(sample: JointSample) -> None:
    """Print one state."""
    print(json.dumps([time.monotonic(), sample.stamp, sample.position.tolist()]), flush=True)


with stop_requested() as stop:
    node = Node("watch", context=fresh_context())
    subscribe(node, JOINT_STATES, say)
    spin(node, stop)
