"""What a person's keys mean: motions that last while keys arrive, speed, and requests to the recorder."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rled_teleop.operators.jog import Jog

Vector = NDArray[np.float64]

SPEEDS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
"""Shares of Δq_max that the speed keys step through."""
LINEAR_SPEED = 0.5
"""Speed of the end effector at full share (m/s)."""


class Request(Enum):
    """What a key asks of somebody else than the robot."""

    START = "start"
    STOP = "stop"
    KEEP = "keep"
    DISCARD = "discard"
    MARK = "mark pose"
    QUIT = "quit"


REQUESTS = {
    "b": Request.START,
    "n": Request.STOP,
    "k": Request.KEEP,
    "x": Request.DISCARD,
    "m": Request.MARK,
    "Q": Request.QUIT,
}
LINEAR = {
    "w": (1.0, 0.0, 0.0),
    "s": (-1.0, 0.0, 0.0),
    "a": (0.0, 1.0, 0.0),
    "d": (0.0, -1.0, 0.0),
    "r": (0.0, 0.0, 1.0),
    "f": (0.0, 0.0, -1.0),
}
"""Direction in the base frame that each key moves the end effector in."""
TURNS = {"right": 1.0, "up": 1.0, ".": 1.0, "left": -1.0, "down": -1.0, ",": -1.0}
"""Sense in which each key turns the chosen joint."""
FASTER, SLOWER = ("+", "="), ("-", "_")


@dataclass(frozen=True)
class KeyMotion:
    """What a held key moves: one joint, or the end effector.

    Attributes:
        joint: which joint, None for the end effector.
        direction: sense of the joint, (1,), or direction of the end effector, (3,).
    """

    joint: int | None
    direction: tuple[float, ...]


class Keyboard:
    """A person's keys. A key's motion lasts ``timeout`` after it last arrived: a held key repeats itself.

    Args:
        joints: of the robot.
        timeout: deadman time (s).

    Attributes:
        joints: of the robot.
        joint: the chosen one.
        speed: place in ``SPEEDS``.
        refused: why the newest key did nothing; empty for one that did something.
    """

    def __init__(self, joints: int, timeout: float) -> None:
        self.joints, self._timeout = joints, timeout
        self._motion: KeyMotion | None = None
        self._until = -np.inf
        self.joint, self.speed, self.refused = 0, SPEEDS.index(1 / 4), ""

    @property
    def share(self) -> float:
        """Of Δq_max, and of the end effector's full speed."""
        return SPEEDS[self.speed]

    def press(self, key: str, now: float) -> Request | None:
        """Take a key at a time (s): a motion, a setting, a request that is handed back; any other key stops."""
        self.refused = ""
        if key in REQUESTS:
            self.stop()
            return REQUESTS[key]
        if key in LINEAR:
            self._move(KeyMotion(None, LINEAR[key]), now)
        elif key in TURNS:
            self._move(KeyMotion(self.joint, (TURNS[key],)), now)
        elif key in FASTER or key in SLOWER:
            self.speed = min(max(self.speed + (1 if key in FASTER else -1), 0), len(SPEEDS) - 1)
        else:
            self.stop()
            if key.isascii() and key.isdigit():
                self._choose(int(key))
        return None

    def _choose(self, number: int) -> None:
        if 1 <= number <= self.joints:
            self.joint = number - 1
        else:
            self.refused = f"there is no joint {number}: 1 to {self.joints}"

    def stop(self) -> None:
        """Let go of every key."""
        self._motion = None

    def motion(self, now: float) -> KeyMotion | None:
        """What is moved at a time (s); None when no key is held."""
        return self._motion if now < self._until else None

    def delta(self, jog: Jog, q: Vector, now: float) -> Vector | None:
        """Δq (rad) for joint angles ``q`` at a time (s), shape (n,); None when no key is held."""
        motion = self.motion(now)
        if motion is None:
            return None
        if motion.joint is not None:
            return jog.joint(q, motion.joint, motion.direction[0] * self.share)
        length = LINEAR_SPEED * self.share * jog.task.period * 1e-9
        return jog.cartesian(q, length * np.array(motion.direction))

    def _move(self, motion: KeyMotion, now: float) -> None:
        self._motion, self._until = motion, now + self._timeout
