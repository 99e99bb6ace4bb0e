"""A stranger that sends large messages on all topics: ``flood.py SECONDS [BYTES]``; then it leaves.

Half of them are messages of their type, as large as they are; the rest is garbage.
"""

import sys
import time
from itertools import count

import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.ros.liveliness import offer_liveliness
from rled_msgs_py.topics import DIAGNOSTICS, JOINT_STATE, MARKERS, RECORDED, ROBOT_DESCRIPTION, TASK_DESCRIPTION, Qos
from rled_msgs_py.topics import Topic as T

DEVICE = T("device/joint_states", JOINT_STATE, Qos(depth=1))
TOPICS = (*RECORDED, DIAGNOSTICS, MARKERS, DEVICE)
GARBAGE = b"\0\1\0\0"


def large(kind: type, number: int, size: int) -> bytes:
    """A message of a class, of so many bytes, unlike the one before."""
    text = f"{number:08d}" + "x" * (size - 100)
    if "name" in kind.get_fields_and_field_types():  # type: ignore[attr-defined]
        return bytes(serialize_message(kind(name=[text], position=[0.1])))
    if "data" in kind.get_fields_and_field_types():  # type: ignore[attr-defined]
        return bytes(serialize_message(kind(data=text)))
    message = kind()
    if "header" in kind.get_fields_and_field_types():  # type: ignore[attr-defined]
        message.header.frame_id = text
    return bytes(serialize_message(message)) + bytes(size)


def main() -> None:
    """Send until it is time to go."""
    until, size = float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 3_000_000
    rclpy.init()
    node = Node("flood")
    outputs = []
    for topic in TOPICS:
        kind = MESSAGE_CLASSES[topic.type]
        if topic in (ROBOT_DESCRIPTION, TASK_DESCRIPTION):
            outputs.append((kind, offer_liveliness(node, topic)))
        else:
            outputs.append((kind, node.create_publisher(kind, topic.name, qos_profile(topic.qos))))
    until += time.monotonic()
    sent = 0
    for number in count():
        for kind, output in outputs:
            if time.monotonic() > until:
                print(f"sent {sent} messages of {size} bytes", flush=True)
                return
            output.publish(large(kind, number, size) if number % 2 else GARBAGE + bytes(size))
            sent += 1


if __name__ == "__main__":
    main()
