"""Faults on purpose, those that section 3.5.2 of the thesis names: delays, noise, lost messages, what cannot be seen.

A ``Line`` lies between whoever acts and the simulation, in the node and in the Gymnasium wrapper alike, so one seed
gives the same faults in both. Without faults it draws nothing and changes nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import ContractError
from rled_msgs_py.params import described, param, parameters_of
from rled_msgs_py.records import PoseSample
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.validation import check_fields

T = TypeVar("T")

STREAM = 1
"""Tells the generator of faults from the task's, which has the same seed."""


def _steps(description: str) -> Any:
    return param(0, description, low=0, high=1000)


def _share(description: str) -> Any:
    return param(0.0, description, low=0.0, high=1.0)


@described
@dataclass(frozen=True)
class Faults:
    """Which faults there are; the same names are parameters of ``sim_node``."""

    observation_delay: int = _steps("steps after which a state is seen")
    observation_delay_spread: int = _steps("up to so many steps more, drawn for each state")
    control_delay: int = _steps("steps after which a displacement is carried out; until then the robot stays")
    control_delay_spread: int = _steps("up to so many steps more, drawn for each displacement")
    reward_delay: int = _steps("steps after which a reward is paid; the last step of an episode pays what is left")
    reward_delay_spread: int = _steps("up to so many steps more, drawn for each reward")
    sensor_noise: float = param(0.0, "deviation of the measured joint angles (rad)", low=0.0, high=1.0)
    actuator_noise: float = param(0.0, "deviation of a displacement, in units of its greatest", low=0.0, high=10.0)
    observation_loss: float = _share("share of states that are lost: the one before is repeated in its place")
    command_loss: float = _share("share of displacements that are lost: the robot stays")
    command_repeat: float = _share("share of displacements in whose place the one before is repeated")
    hidden: str = param("", "what is not seen, in words: names of joints, ee, target; the middle of its range is seen")

    def __post_init__(self) -> None:
        check_fields(self)
        for each in parameters_of(Faults):
            each.spec.check(each.name, getattr(self, each.name))

    @property
    def any(self) -> bool:
        """There is a fault."""
        return any(getattr(self, each.name) != each.default for each in fields(Faults))


NO_FAULTS = Faults()


def hidden_names(text: str, joint_names: Sequence[str]) -> list[str]:
    """What is hidden.

    Raises:
        ContractError: there is no such thing.
    """
    known, names = (*joint_names, "ee", "target"), text.split()
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ContractError(f"hidden is '{' '.join(unknown)}'", ", ".join(known))
    return names


class Line:
    """The way of displacements to the robot, and of states and rewards back."""

    def __init__(
        self, faults: Faults, task: TaskDescription, position: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    ) -> None:
        """Lay a line.

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
        """Have other faults from now on; where they differ, what is under way is lost.

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
        """An episode begins: nothing is under way, and its first state is seen at once."""
        self._states, self._rewards = _Way[Tick](), _Way[float]()
        self._seen: Tick | None = None
        self.halt()

    def halt(self) -> None:
        """No displacement is under way any more."""
        self._commands = _Way[list[float]]()
        self._carried: list[float] | None = None

    def act(self, delta: list[float] | None) -> list[float] | None:
        """A period begins and ``delta`` (rad), n, is sent: the displacement that arrives at the robot, if one does."""
        faults = self._faults
        if not self._any:
            return delta
        if delta is not None and not self._happens(faults.command_loss):
            self._commands.send(delta, self._late(faults.control_delay, faults.control_delay_spread))
        arrived = self._commands.newest()
        if arrived is None:
            return None
        if self._carried is not None and self._happens(faults.command_repeat):
            arrived = self._carried
        self._carried = arrived
        return self._shaken(arrived)

    def see(self, tick: Tick) -> Tick:
        """What is seen of a state: an older one perhaps, under the stamp of this one, which asks for an answer."""
        if not self._any:
            return tick
        faults = self._faults
        measured = self._veiled(self._measured(tick))
        if not self._happens(faults.observation_loss):
            self._states.send(measured, self._late(faults.observation_delay, faults.observation_delay_spread))
        self._seen = self._states.newest() or self._seen or measured
        joints, ee, target, _ = self._seen
        stamp, status = tick.stamp, replace(tick.status, reward=self._paid(tick))
        return Tick(replace(joints, stamp=stamp), replace(ee, stamp=stamp), replace(target, stamp=stamp), status)

    def _happens(self, share: float) -> bool:
        return share > 0.0 and self._rng.random() < share

    def _late(self, delay: int, spread: int) -> int:
        return delay + int(self._rng.integers(spread + 1)) if spread else delay

    def _shaken(self, delta: list[float]) -> list[float]:
        if not self._faults.actuator_noise:
            return delta
        deviation = self._faults.actuator_noise * self._task.max_delta
        shaken: list[float] = (delta + self._rng.normal(0.0, deviation, len(delta))).tolist()
        return shaken

    def _measured(self, tick: Tick) -> Tick:
        if not self._faults.sensor_noise:
            return tick
        q = tick.joints.position + self._rng.normal(0.0, self._faults.sensor_noise, self._task.action_size)
        q = np.clip(q, self._task.joint_lower, self._task.joint_upper)
        return tick._replace(joints=replace(tick.joints, position=q), ee=replace(tick.ee, position=self._position(q)))

    def _veiled(self, tick: Tick) -> Tick:
        joints, task = tick.joints, self._task
        veiled = [name in self._hidden for name in joints.names]
        if any(veiled):
            middle = (np.array(task.joint_lower) + task.joint_upper) / 2.0
            position, velocity = np.where(veiled, middle, joints.position), np.where(veiled, 0.0, joints.velocity)
            joints = replace(joints, position=position, velocity=velocity)
        ee = self._anywhere(tick.ee) if "ee" in self._hidden else tick.ee
        target = self._anywhere(tick.target) if "target" in self._hidden else tick.target
        return tick._replace(joints=joints, ee=ee, target=target)

    def _anywhere(self, pose: PoseSample) -> PoseSample:
        """The middle of the workspace."""
        position = pose.position.copy()
        position[list(self._task.axes)] = (np.array(self._task.workspace_lower) + self._task.workspace_upper) / 2.0
        return PoseSample(pose.stamp, pose.frame, position)

    def _paid(self, tick: Tick) -> float:
        faults, status = self._faults, tick.status
        self._rewards.send(status.reward, self._late(faults.reward_delay, faults.reward_delay_spread))
        over = status.terminated or status.truncated
        return sum(self._rewards.all() if over else self._rewards.due())


class _Way(Generic[T]):
    """Messages under way; each call of ``newest`` or ``due`` is one step of time."""

    def __init__(self) -> None:
        self._now = 0
        self._sent: list[tuple[int, T]] = []

    def send(self, message: T, late: int) -> None:
        """Send a message that arrives so many steps from now."""
        self._sent.append((self._now + late, message))

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
        """All messages still under way."""
        messages = [message for _, message in self._sent]
        self._sent.clear()
        return messages
