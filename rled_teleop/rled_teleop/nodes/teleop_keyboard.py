"""Node: a person drives the robot by the keys of a plain terminal, over SSH too."""

import time
from dataclasses import dataclass
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rled_msgs_py.params import param
from rled_msgs_py.ros.node import declare, run_node, spin

from rled_teleop.nodes.operator_base import OperatorBase, OperatorBaseParams
from rled_teleop.nodes.recorder_client import RecorderClient
from rled_teleop.operators.jog import Jog
from rled_teleop.operators.keyboard_screen import ScreenState, screen, waiting_screen
from rled_teleop.operators.keys import Keyboard, Request
from rled_teleop.operators.terminal import Screen, TerminalGone, keyboard_screen

REDRAW_PERIOD = 0.1
"""Seconds between two drawings of the screen."""


@dataclass(frozen=True)
class KeyboardParams(OperatorBaseParams):
    """Parameters of the keyboard operator."""

    recorder: str = param("record_demos", "name of the recorder's node", read_only=True)


class TeleopKeyboard(Node):
    """Answers each tick with the motion of the key that is held."""

    def __init__(self, **options: Any) -> None:
        super().__init__("teleop_keyboard", **options)
        self._params = declare(self, KeyboardParams)
        self._recorder = RecorderClient(self, self._params.recorder)
        self._keyboard: Keyboard | None = None
        self._screen: Screen | None = None
        self._drawn = -np.inf
        self._base = OperatorBase(self, self._params.beside_agent, self._steer)

    def begin(self, screen: Screen) -> None:
        """Take keys from a terminal and show the state on it."""
        self._screen = screen
        self._base.start_timer(self._poll)

    def _steer(self, jog: Jog, q: NDArray[np.float64]) -> NDArray[np.float64] | None:
        return self._keyboard_of(jog).delta(jog, q, time.monotonic())

    def _keyboard_of(self, jog: Jog) -> Keyboard:
        if self._keyboard is None or self._keyboard.joints != jog.task.action_size:
            self._keyboard = Keyboard(jog.task.action_size, self._params.timeout)
        return self._keyboard

    def _poll(self) -> None:
        assert self._screen is not None
        try:
            for key in self._screen.read():
                self._press(key)
        except TerminalGone:
            self.context.try_shutdown()
        if not self.context.ok():
            return
        self._base.poll()
        if time.monotonic() - self._drawn >= REDRAW_PERIOD:
            self._drawn = time.monotonic()
            self._screen.draw(self._lines())

    def _press(self, key: str) -> None:
        jog = self._base.jog
        if jog is None:
            request = Request.QUIT if key == "Q" else None
        else:
            request = self._keyboard_of(jog).press(key, time.monotonic())
        if request is Request.QUIT:
            self.context.try_shutdown()
        elif request is not None:
            self._recorder.ask(request)

    def _lines(self) -> list[str]:
        jog, tick = self._base.jog, self._base.tick
        if jog is None or tick is None:
            return waiting_screen(self._base.awaited(), self._recorder.answer)
        keyboard = self._keyboard_of(jog)
        shown = ScreenState(jog.task, tick, keyboard.motion(time.monotonic()), self._base.delta, self._recorder.answer)
        return screen(keyboard, shown)


def _drive(node: TeleopKeyboard, stop: Event) -> None:
    with keyboard_screen() as terminal:
        node.begin(terminal)
        spin(node, stop)


def main() -> None:
    """Run the node."""
    run_node(TeleopKeyboard, KeyboardParams, "teleop_keyboard", "Drive the robot by the keys of a terminal.", _drive)


if __name__ == "__main__":
    main()
