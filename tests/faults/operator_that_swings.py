"""Answers every tick of the planar arm: some to the left, some to the right."""

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.records import DeltaCommand
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.ros.node import advertise, fresh_context, subscribe_ticks
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import JOINT_DELTA

JOINTS = ("shoulder", "elbow")

node = Node("operator", context=fresh_context())
output = advertise(node, JOINT_DELTA)


def answer(tick: Tick) -> None:
    side = 1.0 if tick.status.step % 20 < 10 else -1.0
    output.publish(to_msg(DeltaCommand(tick.stamp, JOINTS, np.array([0.03 * side, 0.0]))))


subscribe_ticks(node, answer)
executor = SingleThreadedExecutor(context=node.context)
executor.add_node(node)
executor.spin()
