"""What carries commands to the simulation and states back, with the faults that it was given."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import PoseSample
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick

from rled_sim.draws import normal_draws, normals
from rled_sim.faults import Faults, hidden_names

T = TypeVar("T")

STREAM = 1
"""Tells the generator of faults from the task's, which has the same seed."""


class FaultChannel:
    """Carries displacements to the robot, and states and rewards back.

    Where there is any fault, each ``act`` and each ``see`` takes the same count of uniforms, whatever becomes of them.
    """

    def __init__(
        self, faults: Faults, task: TaskDescription, position: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    ) -> None:
        """Open a channel.

        Args:
            faults: its faults.
            task: of the robot.
            position: its forward kinematics, so that noise on the angles reaches the end effector.

        Raises:
            ContractError: something to hide that there is not.
        """
        self._task, self._position = task, position
        self._settings: tuple[Any, ...] = ()
        self.configure(faults)
        self.seed(None)

    def configure(self, faults: Faults) -> None:
        """Have other faults from now on; where they differ, what is in transit is lost.

        Raises:
            ContractError: something to hide that there is not.
        """
        self._hidden = hidden_names(faults.hidden, self._task.joint_names)
        settings = tuple(getattr(faults, each.name) for each in fields(Faults))
        if settings != self._settings:
            self._faults, self._any, self._settings = faults, faults.any, settings
            self.begin()

    def seed(self, seed: int | None) -> None:
        """Begin the draws anew; without a seed, somewhere."""
        self._rng = np.random.default_rng(None if seed is None else [seed, STREAM])

    def begin(self) -> None:
        """An episode begins: nothing is in transit, and its first state is seen at once."""
        self._states, self._rewards = _Delay[Tick](), _Delay[float]()
        self._seen: Tick | None = None
        self.halt()

    def halt(self) -> None:
        """No displacement is in transit any more."""
        self._commands = _Delay[list[float]]()
        self._carried: list[float] | None = None

    def act(self, delta: list[float] | None) -> list[float] | None:
        """A period begins and ``delta`` (rad), n, is sent: the displacement that arrives at the robot, if one does."""
        faults = self._faults
        if not self._any:
            return delta
        lost, late, repeated, noise = self._uniforms()
        if delta is not None and lost >= faults.command_loss:
            self._commands.send(delta, delay(late, faults.control_delay, faults.control_delay_spread))
        arrived = self._commands.newest()
        if arrived is None:
            return None
        if self._carried is not None and repeated < faults.command_repeat:
            arrived = self._carried
        self._carried = arrived
        return self._perturbed(arrived, noise)

    def see(self, tick: Tick) -> Tick:
        """What is seen of a state: an older one perhaps, under the stamp of this one, which asks for an answer."""
        if not self._any:
            return tick
        faults = self._faults
        lost, late, paid_late, noise = self._uniforms()
        measured = self._masked(self._measured(tick, noise))
        if lost >= faults.observation_loss:
            self._states.send(measured, delay(late, faults.observation_delay, faults.observation_delay_spread))
        self._seen = self._states.newest() or self._seen or measured
        joints, ee, target, _ = self._seen
        stamp, status = tick.stamp, replace(tick.status, reward=self._paid(tick, paid_late))
        return Tick(replace(joints, stamp=stamp), replace(ee, stamp=stamp), replace(target, stamp=stamp), status)

    def _uniforms(self) -> tuple[float, float, float, NDArray[np.float64]]:
        """What one call draws: three uniforms, and those of the noise."""
        uniforms = self._rng.random(fault_draws(self._task.action_size))
        return *uniforms[:3].tolist(), uniforms[3:]

    def _perturbed(self, delta: list[float], noise: NDArray[np.float64]) -> list[float]:
        if not self._faults.actuator_noise:
            return delta
        std = self._faults.actuator_noise * self._task.max_delta
        perturbed: list[float] = (delta + std * normals(noise, len(delta))).tolist()
        return perturbed

    def _measured(self, tick: Tick, noise: NDArray[np.float64]) -> Tick:
        if not self._faults.sensor_noise:
            return tick
        q = tick.joints.position + self._faults.sensor_noise * normals(noise, self._task.action_size)
        q = np.clip(q, self._task.joint_lower, self._task.joint_upper)
        return tick._replace(joints=replace(tick.joints, position=q), ee=replace(tick.ee, position=self._position(q)))

    def _masked(self, tick: Tick) -> Tick:
        joints, task = tick.joints, self._task
        masked = [name in self._hidden for name in joints.names]
        if any(masked):
            middle = (np.array(task.joint_lower) + task.joint_upper) / 2.0
            position, velocity = np.where(masked, middle, joints.position), np.where(masked, 0.0, joints.velocity)
            joints = replace(joints, position=position, velocity=velocity)
        ee = self._anywhere(tick.ee) if "ee" in self._hidden else tick.ee
        target = self._anywhere(tick.target) if "target" in self._hidden else tick.target
        return tick._replace(joints=joints, ee=ee, target=target)

    def _anywhere(self, pose: PoseSample) -> PoseSample:
        """The middle of the workspace."""
        position = pose.position.copy()
        position[list(self._task.axes)] = (np.array(self._task.workspace_lower) + self._task.workspace_upper) / 2.0
        return PoseSample(pose.stamp, pose.frame, position)

    def _paid(self, tick: Tick, late: float) -> float:
        faults, status = self._faults, tick.status
        self._rewards.send(status.reward, delay(late, faults.reward_delay, faults.reward_delay_spread))
        over = status.terminated or status.truncated
        return sum(self._rewards.all() if over else self._rewards.due())


def fault_draws(joints: int) -> int:
    """How many uniforms one ``act`` or one ``see`` takes, for so many joints."""
    return 3 + normal_draws(joints)


def delay(uniform: float, least: int, spread: int) -> int:
    """Steps until something arrives: ``least``, and up to ``spread`` more."""
    return least + int(uniform * (spread + 1))


class _Delay(Generic[T]):
    """Messages in transit; each call of ``newest`` or ``due`` is one step of time."""

    def __init__(self) -> None:
        self._now = 0
        self._sent: list[tuple[int, T]] = []

    def send(self, message: T, steps: int) -> None:
        """Send a message that arrives so many steps from now."""
        self._sent.append((self._now + steps, message))

    def due(self) -> list[T]:
        """All messages that arrive now."""
        arrived = [message for due, message in self._sent if due <= self._now]
        self._sent = [each for each in self._sent if each[0] > self._now]
        self._now += 1
        return arrived

    def newest(self) -> T | None:
        """The message sent last of those that arrive now; what it has overtaken is lost."""
        arrived = [number for number, (due, _) in enumerate(self._sent) if due <= self._now]
        self._now += 1
        if not arrived:
            return None
        message = self._sent[arrived[-1]][1]
        del self._sent[: arrived[-1] + 1]
        return message

    def all(self) -> list[T]:
        """All messages still in transit."""
        messages = [message for _, message in self._sent]
        self._sent.clear()
        return messages
