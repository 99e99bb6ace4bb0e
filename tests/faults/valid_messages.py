"""A valid message for each topic, of the planar arm; hostile ones are made of these."""

import json
from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import Point
from rled_msgs_py.records import (
    Actor,
    DeltaCommand,
    GateCode,
    GateDecision,
    Health,
    JointSample,
    Level,
    PoseSample,
    Record,
    TaskStatus,
    Text,
)
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, to_msg
from rled_msgs_py.topics import Qos, Topic
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Joy
from visualization_msgs.msg import Marker, MarkerArray

from rled_msgs_py import topics

STAMP = 12_345
"""Stands for the stamp of the newest tick, which is known when a message is sent (ns)."""
PLANAR = ROBOTS["planar"]
JOINTS = ("shoulder", "elbow")
Q = (-0.9, 1.8)
JOY = Topic("joy", "sensor_msgs/msg/Joy", Qos(depth=10))
DEVICE = Topic("device/joint_states", topics.JOINT_STATE, Qos(depth=1))
CLASSES = MESSAGE_CLASSES | {JOY.type: Joy}

_joints = JointSample(STAMP, JOINTS, Q, (0.1, -0.1))
_pose = PoseSample(STAMP, "world", PLANAR.chain.position(Q))
_delta = DeltaCommand(STAMP, JOINTS, (0.05, -0.05))
_event = {"event": "start", "episode": 3, "stamp": STAMP, "outcome": "", "operator": "me", "robot": "planar"}
_records: Mapping[Topic, Record] = {
    topics.JOINT_STATES: _joints,
    topics.EE_POSE: _pose,
    topics.TARGET_POSE: _pose,
    topics.TARGET_REQUEST: _pose,
    topics.TASK_STATUS: TaskStatus(STAMP, 3, 2, -0.1, 1, False, 0, False, False),
    topics.JOINT_DELTA: _delta,
    topics.HUMAN_JOINT_DELTA: _delta,
    topics.SAFETY_GATE: GateDecision(
        STAMP, Level.WARN, Actor.EXPERT, "unsure", 0.5, 0.1, "iqr", episode=3, step=2, code=GateCode.UNSURE
    ),
    topics.MARKED_JOINT_STATES: _joints,
    topics.MARKED_EE_POSE: _pose,
    topics.EPISODE_EVENTS: Text(json.dumps(_event)),
    topics.ROBOT_DESCRIPTION: Text(PLANAR.description),
    topics.TASK_DESCRIPTION: Text(reach_task(PLANAR).description.to_json()),
    topics.DIAGNOSTICS: Health(STAMP, Level.OK, "sim: driver", "real_time", {"ticks": "3"}),
    DEVICE: _joints,
}
VALID: Mapping[Topic, Any] = {
    **{topic: to_msg(record) for topic, record in _records.items()},
    JOY: Joy(axes=[0.5] * 8, buttons=[0, 0, 0, 0, 1, 0, 0, 0]),
    topics.MARKERS: MarkerArray(markers=[Marker(ns="curve", points=[Point(x=0.5), Point(y=0.5)])]),
    topics.CLOCK_TOPIC: Clock(),
}
