"""Node: the robot follows another device that a person moves by hand, through a declared mapping (kinesthetic mode)."""

import time
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rled_msgs_py.errors import RledError
from rled_msgs_py.messages import decode
from rled_msgs_py.params import param
from rled_msgs_py.records import JointSample
from rled_msgs_py.ros.callbacks import ends_node, listen
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.ros.node import declare, run_node
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from rled_msgs_py.topics import JOINT_STATE, JOINT_STATES, Qos

from rled_teleop.nodes.operator_base import OperatorBase, OperatorBaseParams
from rled_teleop.operators.follower import Follower
from rled_teleop.operators.jog import Jog
from rled_teleop.operators.mapping import RecordingMapping

_fixed = partial(param, read_only=True)
DEVICE_QOS = Qos(depth=1, reliability="best_effort")
"""Takes what any publisher offers; only the newest sample counts."""


@dataclass(frozen=True)
class KinestheticParams(OperatorBaseParams):
    """Parameters of kinesthetic mode."""

    device_topic: str = _fixed("device/joint_states", "sensor_msgs/JointState of the device that a person moves")
    mapping: str = _fixed(
        "",
        "g_rec: YAML, or a .yaml file: {robot_joint: {name: device_joint, scale: 1.0, offset: 0.0}, ...}; "
        "empty: the same names",
    )
    speed: float = _fixed(1.0, "share of Δq_max that the robot follows with", low=0.01, high=1.0)


class TeleopKinesthetic(Node):
    """Answers each tick with a displacement towards the device's joints."""

    def __init__(self, **options: Any) -> None:
        super().__init__("teleop_kinesthetic", **options)
        self._params = declare(self, KinestheticParams)
        self._follower: Follower | None = None
        self._base = OperatorBase(self, self._params.beside_agent, self._steer)
        message, qos = MESSAGE_CLASSES[JOINT_STATE], qos_profile(DEVICE_QOS)
        listen(self, message, self._params.device_topic, qos, self._on_device)
        self._base.start_timer(self._base.poll)
        report_waiting(self, self._awaited)

    def _awaited(self) -> str:
        if awaited := self._base.awaited():
            return awaited
        program = "the driver of the device, or name its topic with --device-topic,"
        is_heard = self._follower is not None and self._follower.is_heard
        return "" if is_heard else waiting_for(self, program, self._params.device_topic)

    def _steer(self, jog: Jog, q: NDArray[np.float64]) -> NDArray[np.float64] | None:
        return self._follower_of(jog).delta(jog, q, time.monotonic())

    def _follower_of(self, jog: Jog) -> Follower:
        if self._follower is None or self._follower.mapping.joints != jog.task.joint_names:
            with ends_node():
                mapping = RecordingMapping.from_yaml(self._params.mapping, jog.task.joint_names)
            self._follower = Follower(mapping, self._params.speed, self._params.timeout)
        return self._follower

    def _on_device(self, data: bytes) -> None:
        if self._base.jog is None:
            return
        follower = self._follower_of(self._base.jog)
        try:
            sample = decode(JOINT_STATES, data)
            assert isinstance(sample, JointSample)
            follower.take(sample, time.monotonic())
        except RledError as error:
            self.get_logger().error(f"{self._params.device_topic}: {error}", throttle_duration_sec=1.0)


def main() -> None:
    """Run the node."""
    summary = "Let the robot follow a device that a person moves by hand."
    run_node(TeleopKinesthetic, KinestheticParams, "teleop_kinesthetic", summary)


if __name__ == "__main__":
    main()
