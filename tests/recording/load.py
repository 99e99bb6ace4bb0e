"""Five topics at 1 kHz each, published from a process of their own, with the time of every publication."""

import mmap
import os
import signal
import struct
import time
from dataclasses import replace

import numpy as np
import rclpy
from rled_msgs_py.messages import encode
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, TaskStatus, Text
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile, to_msg
from rled_msgs_py.ros.node import advertise
from rled_msgs_py.topics import (
    EE_POSE,
    JOINT_DELTA,
    JOINT_STATES,
    ROBOT_DESCRIPTION,
    TARGET_POSE,
    TASK_DESCRIPTION,
    TASK_STATUS,
)
from rled_sim.robots import robot_named
from rled_sim.tasks import reach_task

PERIOD = 1_000_000
"""Simulation time between two messages of a topic (ns)."""
FIVE = (JOINT_STATES, EE_POSE, TARGET_POSE, TASK_STATUS, JOINT_DELTA)
SLIP = 0.02
DEPTH = 200
"""Messages that each publisher keeps until they are acknowledged."""
STAMP = struct.Struct("<iI")
ROBOT = robot_named("panda")


def shared(*shape: int) -> np.ndarray:
    """Zeros (float64) that processes forked from this one share."""
    count = int(np.prod(shape))
    return np.frombuffer(mmap.mmap(-1, 8 * count), dtype=np.float64).reshape(shape)


def samples() -> list[bytearray]:
    """One serialized message of each of the five topics; the stamp is written into them later."""
    names, zeros = ROBOT.joint_names, np.zeros(len(ROBOT.joint_names))
    pose = PoseSample(0, "world", np.ones(3))
    records = (
        JointSample(0, names, ROBOT.home, zeros),
        pose,
        pose,
        TaskStatus(0, 0, 0, -0.5, 0, False, 0, False, False),
        DeltaCommand(0, names, zeros),
    )
    return [bytearray(encode(topic, record)) for topic, record in zip(FIVE, records, strict=True)]


def publish(published: np.ndarray, wait_for_recorder: bool) -> None:
    """Publish one message of each topic a millisecond; ends when ``published`` is full.

    Held up for longer than ``SLIP`` it goes on from there: to make up for it would be another rate.

    Args:
        published: time of each publication (s, monotonic), shape (k,); filled in.
        wait_for_recorder: begin when somebody listens to ``joint_delta``.
    """
    rclpy.init()
    node = rclpy.create_node("load")
    texts = {TASK_DESCRIPTION: reach_task(ROBOT).description.to_json(), ROBOT_DESCRIPTION: ROBOT.description}
    latched = {topic: advertise(node, topic) for topic in texts}
    for topic, text in texts.items():
        latched[topic].publish(to_msg(Text(text)))
    outputs = [
        node.create_publisher(MESSAGE_CLASSES[topic.type], topic.name, qos_profile(replace(topic.qos, depth=DEPTH)))
        for topic in FIVE
    ]
    while wait_for_recorder and not outputs[-1].get_subscription_count():
        time.sleep(0.01)
    messages, began = samples(), time.monotonic()
    for k in range(len(published)):
        if (ahead := began + k * PERIOD * 1e-9 - time.monotonic()) > 0:
            time.sleep(ahead)
        elif ahead < -SLIP:
            began -= ahead
        published[k] = time.monotonic()
        for output, message in zip(outputs, messages, strict=True):
            STAMP.pack_into(message, 4, *divmod(k * PERIOD, 10**9))
            output.publish(bytes(message))
    for output in outputs:
        output.wait_for_all_acked(rclpy.duration.Duration(seconds=5))
    time.sleep(1.0)
    rclpy.shutdown()


def start_publishing(published: np.ndarray, wait_for_recorder: bool = False) -> int:
    """Publish in a forked process; return its id."""
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        publish(published, wait_for_recorder)
        os._exit(0)
    return child
