"""Names, types and quality of service of every topic, as data (no ROS import).

Names are relative, so a namespace gives a second robot. A latched topic is transient local: whoever
joins late, a restarted node too, receives the newest sample. The state topics are latched, because in
lockstep the simulation waits on the tick that it has published.
"""

from dataclasses import dataclass
from typing import Literal

JOINT_STATE = "sensor_msgs/msg/JointState"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
STRING = "std_msgs/msg/String"
CLOCK = "rosgraph_msgs/msg/Clock"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"


@dataclass(frozen=True)
class Qos:
    """Quality of service as rosbag2 and rclpy both name it.

    Attributes:
        depth: samples kept, history is always keep last.
        reliability: ``reliable`` resends what was lost.
        durability: ``transient_local`` hands the last ``depth`` samples to late joiners.
    """

    depth: int
    reliability: Literal["reliable", "best_effort"] = "reliable"
    durability: Literal["volatile", "transient_local"] = "volatile"


MAX_BYTES = {
    JOINT_STATE: 64 << 10,  # 256 joints with names of a hundred characters have half of it
    POSE_STAMPED: 8 << 10,
    DIAGNOSTIC_ARRAY: 256 << 10,
    STRING: 4 << 20,  # a URDF
    CLOCK: 1 << 10,
    MARKER_ARRAY: 4 << 20,
}
"""Maximum bytes of a message, by its type."""
MAX_BYTES_OF = {"task_description": 256 << 10, "episode_events": 64 << 10}
"""The same of topics that need less than their type."""


@dataclass(frozen=True)
class Topic:
    """One line of the graph's contract: relative name, ROS type and quality of service."""

    name: str
    type: str
    qos: Qos

    @property
    def max_bytes(self) -> int:
        """Maximum bytes of a message; larger ones are refused before they are read or kept."""
        return MAX_BYTES_OF.get(self.name, MAX_BYTES[self.type])


STATE_QOS = Qos(depth=10, durability="transient_local")
COMMAND_QOS = Qos(depth=1)
LATCHED_QOS = Qos(depth=1, durability="transient_local")
EVENT_QOS = Qos(depth=100, durability="transient_local")

JOINT_STATES = Topic("joint_states", JOINT_STATE, STATE_QOS)
EE_POSE = Topic("ee_pose", POSE_STAMPED, STATE_QOS)
TARGET_POSE = Topic("target_pose", POSE_STAMPED, STATE_QOS)
TASK_STATUS = Topic("task_status", DIAGNOSTIC_ARRAY, STATE_QOS)
TARGET_REQUEST = Topic("target_request", POSE_STAMPED, COMMAND_QOS)
JOINT_DELTA = Topic("joint_delta", JOINT_STATE, COMMAND_QOS)
HUMAN_JOINT_DELTA = Topic("human/joint_delta", JOINT_STATE, COMMAND_QOS)
SAFETY_GATE = Topic("safety_gate", DIAGNOSTIC_ARRAY, Qos(depth=10))
MARKED_JOINT_STATES = Topic("marked/joint_states", JOINT_STATE, EVENT_QOS)
MARKED_EE_POSE = Topic("marked/ee_pose", POSE_STAMPED, EVENT_QOS)
EPISODE_EVENTS = Topic("episode_events", STRING, EVENT_QOS)
ROBOT_DESCRIPTION = Topic("robot_description", STRING, LATCHED_QOS)
TASK_DESCRIPTION = Topic("task_description", STRING, LATCHED_QOS)
MARKERS = Topic("markers", MARKER_ARRAY, LATCHED_QOS)
DIAGNOSTICS = Topic("/diagnostics", DIAGNOSTIC_ARRAY, Qos(depth=10))
CLOCK_TOPIC = Topic("/clock", CLOCK, Qos(depth=1, reliability="best_effort"))

RECORDED = (
    ROBOT_DESCRIPTION,
    TASK_DESCRIPTION,
    JOINT_STATES,
    EE_POSE,
    TARGET_POSE,
    TASK_STATUS,
    MARKED_JOINT_STATES,
    MARKED_EE_POSE,
    EPISODE_EVENTS,
    SAFETY_GATE,
    HUMAN_JOINT_DELTA,
    JOINT_DELTA,
)
"""What a demonstration bag holds; ``joint_delta`` stands last, so a matched writer of it sees a ready recorder."""
