"""Following a device that a person moves: from its newest sample to a displacement of the robot."""

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import JointSample

from rled_teleop.operators.demonstration import demonstrated_action
from rled_teleop.operators.jog import Jog
from rled_teleop.operators.mapping import RecordingMapping


class Follower:
    """The newest sample of the device, and what it asks of the robot.

    Args:
        mapping: g_rec.
        speed: share of Δq_max.
        timeout: deadman time (s): a silent device asks for nothing.

    Attributes:
        mapping: as given.
    """

    def __init__(self, mapping: RecordingMapping, speed: float, timeout: float) -> None:
        self.mapping, self._speed, self._timeout = mapping, speed, timeout
        self._goal: NDArray[np.float64] | None = None
        self._until = -np.inf
        self._heard: dict[str, tuple[float, float]] = {}

    @property
    def is_heard(self) -> bool:
        """Whether the device has said anything yet."""
        return self._goal is not None

    def take(self, sample: JointSample, now: float) -> None:
        """Take a sample at a time (s); joints that two publishers tell are put together, others are passed over.

        Raises:
            RledError: the device lacks a joint, or is where no robot can follow.
        """
        wanted = self.mapping.device_joints
        values = zip(sample.names, sample.position.tolist(), strict=True)
        told = {name: angle for name, angle in values if name in wanted}
        if not told and now < self._until:  # of a gripper, beside an arm that is heard
            return
        recent = {name: heard for name, heard in self._heard.items() if now < heard[1] + self._timeout}
        self._heard = recent | {name: (angle, now) for name, angle in told.items()}
        names = tuple(self._heard) or sample.names
        angles = [self._heard[name][0] for name in names] if self._heard else sample.position
        device = JointSample(sample.stamp, names, np.array(angles), np.zeros(len(names)))
        self._goal, self._until = self.mapping.robot_joints(device), now + self._timeout

    def delta(self, jog: Jog, q: NDArray[np.float64], now: float) -> NDArray[np.float64] | None:
        """Δq (rad) towards the device for joint angles ``q`` at a time (s), shape (n,); None when it is silent."""
        if self._goal is None or now >= self._until:
            return None
        return jog.within_limits(q, demonstrated_action(q, self._goal, self._speed * jog.task.max_delta))
