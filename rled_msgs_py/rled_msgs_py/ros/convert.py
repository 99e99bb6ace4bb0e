"""The contract in rclpy's terms: message classes and quality of service."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from rled_msgs_py import topics
from rled_msgs_py.messages import TYPES, decode, encode
from rled_msgs_py.records import Record

MESSAGE_CLASSES = {
    topics.JOINT_STATE: JointState,
    topics.POSE_STAMPED: PoseStamped,
    topics.DIAGNOSTIC_ARRAY: DiagnosticArray,
    topics.STRING: String,
    topics.CLOCK: Clock,
    topics.MARKER_ARRAY: MarkerArray,
}


def to_msg(record: Record) -> Any:
    """The rclpy message of a record, for who wants to look at its fields or change them; nodes publish bytes."""
    kind = TYPES[type(record)]
    data = encode(topics.Topic("", kind, topics.Qos(depth=1)), record)
    return deserialize_message(data, MESSAGE_CLASSES[kind])


def from_msg(topic: topics.Topic, msg: Any) -> Record:
    """The record of an rclpy message.

    Raises:
        ContractError: a wrong size, bad names, NaN or infinity.
    """
    return decode(topic, serialize_message(msg))


def qos_profile(qos: topics.Qos) -> QoSProfile:
    """Profile for rclpy of a contract's quality of service."""
    return QoSProfile(
        depth=qos.depth,
        reliability=QoSReliabilityPolicy[qos.reliability.upper()],
        durability=QoSDurabilityPolicy[qos.durability.upper()],
    )
