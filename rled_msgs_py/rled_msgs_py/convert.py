"""Records to rclpy messages and back: the one module of the contract that imports ROS."""

from array import array
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from rled_msgs_py import topics
from rled_msgs_py.messages import FROM_MSG, TO_MSG, MessageTypes
from rled_msgs_py.records import Record

ROS = MessageTypes(
    Time=Time,
    Header=Header,
    JointState=JointState,
    Point=Point,
    Quaternion=Quaternion,
    Pose=Pose,
    PoseStamped=PoseStamped,
    KeyValue=KeyValue,
    DiagnosticStatus=DiagnosticStatus,
    DiagnosticArray=DiagnosticArray,
    String=String,
    array=lambda vector: array("d", vector.tobytes()),
    octet=lambda value: bytes((value,)),
)

MESSAGE_CLASSES = {
    topics.JOINT_STATE: JointState,
    topics.POSE_STAMPED: PoseStamped,
    topics.DIAGNOSTIC_ARRAY: DiagnosticArray,
    topics.STRING: String,
    topics.CLOCK: Clock,
    topics.MARKER_ARRAY: MarkerArray,
}


def to_msg(record: Record) -> Any:
    """The rclpy message of a record."""
    return TO_MSG[type(record)](record, ROS)


def from_msg(topic: topics.Topic, msg: Any) -> Record:
    """The record of a message received on ``topic``.

    Raises:
        ContractError: a wrong size, bad names, NaN or infinity.
    """
    return FROM_MSG[topic.name](msg)


def qos_profile(qos: topics.Qos) -> QoSProfile:
    """Profile for rclpy of a contract's quality of service."""
    return QoSProfile(
        depth=qos.depth,
        reliability=QoSReliabilityPolicy[qos.reliability.upper()],
        durability=QoSDurabilityPolicy[qos.durability.upper()],
    )
