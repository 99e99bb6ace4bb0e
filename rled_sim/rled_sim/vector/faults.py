"""The faults of N environments at once: ``FaultChannel``, with arrays."""

from collections.abc import Callable, Sequence

import numpy as np
from rled_msgs_py.task import TaskDescription

from rled_sim.draws import normals
from rled_sim.fault_channel import STREAM, fault_draws
from rled_sim.faults import Faults, hidden_names
from rled_sim.vector.arrays import Array, Arrays
from rled_sim.vector.delay import Delay, DelayedRewards
from rled_sim.vector.draws import Draws
from rled_sim.vector.simulation import Episodes
from rled_sim.vector.stateful import Stateful


class BatchFaultChannel(Stateful):
    """Carries displacements to N robots, and their states and rewards back.

    Attributes:
        draws: its uniforms; none are of the task.
        commands: displacements in transit.
        states: observations in transit.
        rewards: rewards in transit.
        carried: the displacement that arrived last (rad), shape (N, n).
        carrying: there is one, shape (N,).
        seen: the observations last seen, shape (N, o).
        seeing: there is one of this episode, shape (N,).
    """

    STATE = ("carried", "carrying", "seen", "seeing")

    def __init__(
        self, arrays: Arrays, num_envs: int, faults: Faults, task: TaskDescription, position: Callable[[Array], Array]
    ) -> None:
        """Open a channel.

        Args:
            arrays: where it lies.
            num_envs: N.
            faults: its faults.
            task: of the robots.
            position: their forward kinematics, so that noise on the angles reaches the end effector.

        Raises:
            ContractError: something to hide that there is not.
        """
        self._arrays, self._faults, self._task, self._position = arrays, faults, task, position
        n, size = task.action_size, len(task.observation_bounds()[0])
        self.draws = Draws(arrays, num_envs, 3 * fault_draws(n), [STREAM])
        self.commands = Delay(arrays, num_envs, faults.control_delay + faults.control_delay_spread, n)
        self.states = Delay(arrays, num_envs, faults.observation_delay + faults.observation_delay_spread, size)
        self.rewards = DelayedRewards(arrays, num_envs, faults.reward_delay + faults.reward_delay_spread)
        self.carried, self.seen = arrays.full((num_envs, n), 0.0), arrays.full((num_envs, size), 0.0)
        self.carrying = self.seeing = arrays.full((num_envs,), False, "bool")
        self._lower, self._upper = arrays.array(task.joint_lower), arrays.array(task.joint_upper)
        self._hide(hidden_names(faults.hidden, task.joint_names))

    def _hide(self, hidden: Sequence[str]) -> None:
        """Where something is hidden, its coordinates are those of a ``middle``; NaN where nothing is."""
        task, array = self._task, self._arrays.array
        joints = (np.array(task.joint_lower) + task.joint_upper) / 2.0
        joints[[name not in hidden for name in task.joint_names]] = np.nan
        point = np.full(3, np.nan)
        point[list(task.axes)] = (np.array(task.workspace_lower) + task.workspace_upper) / 2.0
        nothing = np.full(3, np.nan)
        self._middle = (
            array(joints),
            array(point if "ee" in hidden else nothing),
            array(point if "target" in hidden else nothing),
        )

    def parts(self) -> dict[str, Stateful]:
        """All that has arrays to remember, by name."""
        transit = {"commands": self.commands, "states": self.states, "rewards": self.rewards}
        return {"faults": self, "faults.draws": self.draws} | {f"faults.{name}": each for name, each in transit.items()}

    def begin(self, which: Array, state: Episodes) -> Array:
        """Episodes begin: nothing is in transit, and their first states are seen at once.

        Args:
            which: the environments in which one begins, shape (N,).
            state: where all environments are.

        Returns:
            Observations of all, shape (N, o), float32.
        """
        for each in (self.commands, self.states, self.rewards):
            each.clear(which)
        self.carrying, self.seeing = self.carrying & ~which, self.seeing & ~which
        nothing = which & ~which
        return self.see(which, state, nothing * 0.0, nothing)[0]

    def act(self, which: Array, delta: Array) -> Array:
        """Displacements (rad), shape (N, n), are sent: those that arrive at the robots; 0 where none does."""
        faults, chosen = self._faults, self._arrays.chosen
        uniforms = self.draws.take(which, fault_draws(self._task.action_size))
        lost, late, repeated = uniforms[:, 0], uniforms[:, 1], uniforms[:, 2]
        steps = self._steps(late, faults.control_delay, faults.control_delay_spread)
        self.commands.send(which & (lost >= faults.command_loss), delta, steps)
        arrives, newest = self.commands.newest(which)
        repeats = self.carrying & (repeated < faults.command_repeat)
        self.carried = chosen(arrives & ~repeats, newest, self.carried)
        self.carrying = self.carrying | arrives
        return chosen(arrives, self._perturbed(self.carried, uniforms[:, 3:]), 0.0)

    def see(self, which: Array, state: Episodes, reward: Array, over: Array) -> tuple[Array, Array]:
        """What is seen of states, and what is paid.

        Args:
            which: the environments that have a new state, shape (N,).
            state: where all environments are.
            reward: of the transitions that led there, shape (N,).
            over: their episodes are over, shape (N,).

        Returns:
            Observations of all, shape (N, o), float32, and rewards, shape (N,).
        """
        faults, chosen = self._faults, self._arrays.chosen
        uniforms = self.draws.take(which, fault_draws(self._task.action_size))
        lost, late, paid_late = uniforms[:, 0], uniforms[:, 1], uniforms[:, 2]
        measured = self._measured(state, uniforms[:, 3:])
        steps = self._steps(late, faults.observation_delay, faults.observation_delay_spread)
        self.states.send(which & (lost >= faults.observation_loss), measured, steps)
        arrives, newest = self.states.newest(which)
        self.seen = chosen(arrives, newest, chosen(which & ~self.seeing, measured, self.seen))
        self.seeing = self.seeing | which
        paid_steps = self._steps(paid_late, faults.reward_delay, faults.reward_delay_spread)
        return self._arrays.cast(self.seen, "float32"), self.rewards.pay(which, reward, paid_steps, over)

    def _steps(self, uniforms: Array, least: int, spread: int) -> Array:
        return least + self._arrays.cast(uniforms * (spread + 1), "int64")

    def _perturbed(self, delta: Array, noise: Array) -> Array:
        std = self._faults.actuator_noise * self._task.max_delta
        return delta + std * normals(noise, self._task.action_size) if std else delta

    def _measured(self, state: Episodes, noise: Array) -> Array:
        """The observations of noisy joint angles, without what is hidden."""
        joints, position = state.joints, state.position
        if self._faults.sensor_noise:
            joints = joints + self._faults.sensor_noise * normals(noise, self._task.action_size)
            joints = self._arrays.xp.clip(joints, self._lower, self._upper)
            position = self._position(joints)
        isnan, where = self._arrays.xp.isnan, self._arrays.xp.where
        coordinates = zip((joints, position, state.target), self._middle, strict=True)
        return self._task.observe(*(where(isnan(middle), each, middle) for each, middle in coordinates))
