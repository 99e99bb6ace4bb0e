"""What a gamepad's sticks and buttons mean: motion only while the deadman button is held."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rled_teleop.operators.jog import Jog
from rled_teleop.operators.keys import LINEAR_SPEED, Request

Vector = NDArray[np.float64]

DEAD_ZONE = 0.05
"""Deflection of a stick that counts as none, as in ROS's joy."""
SLOW, TURBO = 0.25, 1.0
"""Shares of the full speed, without and with the turbo button."""


@dataclass(frozen=True)
class PadState:
    """A gamepad as sensor_msgs/Joy gives it.

    Attributes:
        axes: deflections, -1 to 1; left and up are positive.
        buttons: which are pressed.
    """

    axes: tuple[float, ...]
    buttons: tuple[bool, ...]

    def axis(self, number: int) -> float:
        """Deflection of an axis outside the dead zone, -1 to 1; 0 where there is no such axis, and for NaN."""
        value = self.axes[number] if 0 <= number < len(self.axes) else 0.0
        size = min(abs(value), 1.0)
        return float(np.copysign((size - DEAD_ZONE) / (1.0 - DEAD_ZONE), value)) if size > DEAD_ZONE else 0.0

    def pressed(self, number: int) -> bool:
        """Whether a button is pressed; not where there is none."""
        return 0 <= number < len(self.buttons) and self.buttons[number]


@dataclass(frozen=True)
class Layout:
    """Which axis and button does what; the defaults are those of joy_node for an Xbox gamepad.

    Attributes:
        x: axis for the end effector's x.
        y: axis for its y.
        z: axis for its z.
        turn: axis that turns the chosen joint.
        deadman: button without which nothing moves.
        turbo: button for full speed.
        mark: button that marks the pose.
        start: button that begins an episode.
        stop: button that ends it.
        keep: button that keeps the newest episode.
        discard: button that discards it.
        next_joint: button that chooses the next joint.
    """

    x: int = 1
    y: int = 0
    z: int = 4
    turn: int = 3
    deadman: int = 4
    turbo: int = 5
    mark: int = 0
    start: int = 7
    stop: int = 6
    keep: int = 3
    discard: int = 1
    next_joint: int = 2


class Gamepad:
    """A person's gamepad. Its newest state counts for ``timeout`` seconds.

    Args:
        layout: of axes and buttons.
        joints: of the robot.
        timeout: deadman time (s).

    Attributes:
        joints: of the robot.
        joint: the one that the turning stick turns.
    """

    def __init__(self, layout: Layout, joints: int, timeout: float) -> None:
        self._layout, self.joints, self._timeout = layout, joints, timeout
        self._state, self._until = PadState((), ()), -np.inf
        self.joint = 0

    def take(self, state: PadState, now: float) -> list[Request]:
        """Take a state at a time (s); return what the buttons that were pressed since the last one ask for."""
        before, self._state, self._until = self._state, state, now + self._timeout
        if self._is_new(before, self._layout.next_joint):
            self.joint = (self.joint + 1) % self.joints
        return [request for name, request in _REQUESTS.items() if self._is_new(before, getattr(self._layout, name))]

    def delta(self, jog: Jog, q: Vector, now: float) -> Vector | None:
        """Δq (rad) for joint angles ``q`` at a time (s), shape (n,); None when the deadman button is not held.

        The turning stick comes before the others.
        """
        if now >= self._until or not self._state.pressed(self._layout.deadman):
            return None
        share = TURBO if self._state.pressed(self._layout.turbo) else SLOW
        if turn := self._state.axis(self._layout.turn):
            return jog.joint(q, self.joint, share * turn)
        direction = np.array([self._state.axis(each) for each in (self._layout.x, self._layout.y, self._layout.z)])
        return jog.cartesian(q, LINEAR_SPEED * share * jog.task.period * 1e-9 * direction, share)

    def _is_new(self, before: PadState, button: int) -> bool:
        return self._state.pressed(button) and not before.pressed(button)


_REQUESTS = {
    "mark": Request.MARK,
    "start": Request.START,
    "stop": Request.STOP,
    "keep": Request.KEEP,
    "discard": Request.DISCARD,
}
"""What each button asks of the recorder."""
