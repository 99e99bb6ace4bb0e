"""Node: a person drives the robot by a gamepad, read from the topic ``joy`` or from the device itself."""

import time
from dataclasses import dataclass
from functools import partial
from typing import Any

from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rled_msgs_py.params import param
from rled_msgs_py.ros.callbacks import ends_node, listen
from rled_msgs_py.ros.node import declare, run_node
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from sensor_msgs.msg import Joy

from rled_teleop.nodes.operator_base import OperatorBase, OperatorBaseParams
from rled_teleop.nodes.recorder_client import RecorderClient
from rled_teleop.operators.gamepad import Gamepad, Layout, PadState
from rled_teleop.operators.gamepad_device import Device, open_pad, read_pad
from rled_teleop.operators.jog import Jog

MAX_JOY_BYTES = 4096
"""Bytes of a message on joy: hundreds of axes and buttons."""
_number = partial(param, low=-1, high=63, read_only=True)


@dataclass(frozen=True)
class GamepadParams(OperatorBaseParams):
    """Parameters of the gamepad operator; axes and buttons are numbered as in sensor_msgs/Joy, -1 is none."""

    recorder: str = param("record_demos", "name of the recorder's node", read_only=True)
    device: str = param(
        "", "read this device (/dev/input/event5, or auto) instead of the topic joy; needs evdev", read_only=True
    )
    axis_x: int = _number(1, "axis for the end effector's x")
    axis_y: int = _number(0, "axis for its y")
    axis_z: int = _number(4, "axis for its z")
    axis_turn: int = _number(3, "axis that turns the chosen joint")
    button_deadman: int = _number(4, "button without which nothing moves")
    button_turbo: int = _number(5, "button for full speed")
    button_mark: int = _number(0, "button that marks the pose")
    button_start: int = _number(7, "button that begins an episode")
    button_stop: int = _number(6, "button that ends it")
    button_keep: int = _number(3, "button that keeps the newest episode")
    button_discard: int = _number(1, "button that discards it")
    button_next_joint: int = _number(2, "button that chooses the next joint to turn")

    def layout(self) -> Layout:
        """Which axis and button does what."""
        axes = {name: getattr(self, f"axis_{name}") for name in ("x", "y", "z", "turn")}
        names = ("deadman", "turbo", "mark", "start", "stop", "keep", "discard", "next_joint")
        return Layout(**axes, **{name: getattr(self, f"button_{name}") for name in names})


class TeleopGamepad(Node):
    """Answers each tick with the motion of the sticks while the deadman button is held."""

    def __init__(self, **options: Any) -> None:
        super().__init__("teleop_gamepad", **options)
        self._params = declare(self, GamepadParams)
        self._device: Device | None = open_pad(self._params.device) if self._params.device else None
        self._is_heard = self._device is not None
        self._recorder = RecorderClient(self, self._params.recorder)
        self._gamepad: Gamepad | None = None
        self._said = ""
        self._base = OperatorBase(self, self._params.beside_agent, self._steer)
        if self._device is None:
            listen(self, Joy, "joy", QoSProfile(depth=10), self._on_joy, MAX_JOY_BYTES)
        self._base.start_timer(self._poll)
        report_waiting(self, self._awaited)

    def _awaited(self) -> str:
        if (awaited := self._base.awaited()) or self._is_heard:
            return awaited
        return waiting_for(self, "joy_node, or this with --device auto,", "joy")

    def _steer(self, jog: Jog, q: NDArray[Any]) -> NDArray[Any] | None:
        return self._gamepad_of(jog).delta(jog, q, time.monotonic())

    def _gamepad_of(self, jog: Jog) -> Gamepad:
        if self._gamepad is None or self._gamepad.joints != jog.task.action_size:
            self._gamepad = Gamepad(self._params.layout(), jog.task.action_size, self._params.timeout)
        return self._gamepad

    def _on_joy(self, data: bytes) -> None:
        msg = deserialize_message(data, Joy)
        self._is_heard = True
        self._take(PadState(tuple(msg.axes), tuple(map(bool, msg.buttons))))

    def _poll(self) -> None:
        if self._device is not None:
            with ends_node():
                state = read_pad(self._device)
            self._take(state)
        self._base.poll()
        if self._recorder.answer != self._said:
            self._said = self._recorder.answer
            self.get_logger().info(f"recorder: {self._said}")

    def _take(self, state: PadState) -> None:
        if self._base.jog is None:
            return
        for request in self._gamepad_of(self._base.jog).take(state, time.monotonic()):
            self._recorder.ask(request)


def main() -> None:
    """Run the node."""
    run_node(TeleopGamepad, GamepadParams, "teleop_gamepad", "Drive the robot by a gamepad.")


if __name__ == "__main__":
    main()
