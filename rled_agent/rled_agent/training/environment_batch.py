"""The environments of P seeds, stepped together: batched ones of this project, or any of Gymnasium's one by one."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias, runtime_checkable

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.task import TaskDescription
from rled_sim.spaces import action_space, observation_space
from rled_sim.vector.reach import ReachBatch
from torch import Tensor

Environment: TypeAlias = gymnasium.Env[Any, Any]
Space: TypeAlias = gymnasium.spaces.Space[Any]
STREAM = 3
"""Tells the seeds of episodes from other draws of the same seed."""


class EnvironmentStep(NamedTuple):
    """What one step of each environment came to; nothing of it changes later.

    Attributes:
        observation: that it led to, physical, shape (P, o).
        reward: shape (P,).
        terminated: the task ended, shape (P,).
        truncated: the episode was cut, shape (P,).
        targets_reached: of the episode so far, NaN where the environment tells none, shape (P,).
        violations: likewise.
        risky: the state is risky, NaN where the environment does not tell, shape (P,).
    """

    observation: Tensor
    reward: Tensor
    terminated: Tensor
    truncated: Tensor
    targets_reached: Tensor
    violations: Tensor
    risky: Tensor


class EnvironmentBatch(Protocol):
    """Environments of one kind that are stepped together."""

    @property
    def size(self) -> int:
        """P."""
        ...

    @property
    def task(self) -> TaskDescription | None:
        """The task of this project's environments, else None."""
        ...

    @property
    def observation_space(self) -> Space:
        """Of each of them, physical."""
        ...

    @property
    def action_space(self) -> Space:
        """Of each of them, physical."""
        ...

    def seed(self, seeds: Sequence[int]) -> None:
        """Begin the draws of each anew."""
        ...

    def begin(self, where: Tensor) -> Tensor:
        """Begin an episode where the mask, shape (P,), holds; all present observations, physical, shape (P, o)."""
        ...

    def announce(self, action: Tensor) -> None:
        """Send the action of the next ``step`` already, to what moves while this process learns."""
        ...

    def step(self, action: Tensor) -> EnvironmentStep:
        """Act, physical, shape (P, n)."""
        ...

    def states(self) -> list[dict[str, Tensor]]:
        """The state of each, to go on from."""
        ...

    def restore(self, states: Sequence[Mapping[str, Tensor]]) -> bool:
        """Go on from ``states``; whether the episodes go on where they were, or have to begin anew."""
        ...

    def close(self) -> None:
        """Close them."""
        ...


class ReachEnvironments(EnvironmentBatch):
    """This project's kinematic environments, as arrays on one device.

    Args:
        batch: the robots.
        device: that tensors are on.
    """

    def __init__(self, batch: ReachBatch, device: torch.device) -> None:
        self._batch, self._device = batch, device

    @property
    def size(self) -> int:
        """P."""
        return self._batch.num_envs

    @property
    def task(self) -> TaskDescription:
        """Their task."""
        return self._batch.task

    @property
    def observation_space(self) -> Space:
        """Of their task."""
        return observation_space(self.task)

    @property
    def action_space(self) -> Space:
        """Of their task."""
        return action_space(self.task)

    def seed(self, seeds: Sequence[int]) -> None:
        """Begin the draws of each anew."""
        self._batch.seed(seeds)

    def begin(self, where: Tensor) -> Tensor:
        """Begin episodes."""
        return self._tensor(self._batch.begin(self._array(where)))

    def announce(self, action: Tensor) -> None:
        """Nothing moves meanwhile."""

    def step(self, action: Tensor) -> EnvironmentStep:
        """Act."""
        step = self._batch.step(self._array(action))
        return EnvironmentStep(*map(self._tensor, step))

    def states(self) -> list[dict[str, Tensor]]:
        """Joint angles, targets, counts and draws."""
        whole = {name: self._tensor(each) for name, each in self._batch.state_dict().items()}
        return [{name: each[k : k + 1] for name, each in whole.items()} for k in range(self.size)]

    def restore(self, states: Sequence[Mapping[str, Tensor]]) -> bool:
        """Go on where they were."""
        names = states[0].keys()
        self._batch.load_state_dict({name: self._array(torch.cat([each[name] for each in states])) for name in names})
        return True

    def close(self) -> None:
        """They hold nothing."""

    def _tensor(self, array: Any) -> Tensor:
        return array if isinstance(array, Tensor) else torch.from_numpy(np.asarray(array))

    def _array(self, tensor: Tensor) -> Any:
        return tensor.numpy() if self._device.type == "cpu" else tensor.to(self._device)


@runtime_checkable
class Asynchronous(Protocol):
    """An environment that is not in this process, so that it can move while this process learns."""

    def begin(self, action: Any) -> None:
        """Send the action of the next ``step`` already."""
        ...


def is_repeatable(env: Environment) -> bool:
    """Whether an episode begun with the same seed and driven by the same actions is the same again.

    A simulation is; an arm is not, and would make motions that nobody asked for. An environment that does not say is
    taken for a simulation.
    """
    return bool(getattr(env.unwrapped, "is_repeatable", True))


class OneByOne(EnvironmentBatch):
    """Environments of Gymnasium, one for each seed.

    Each episode is seeded, so that an environment comes to where it was by the actions of its episode alone.

    Args:
        envs: one for each seed.
        device: that tensors are on.
    """

    def __init__(self, envs: Sequence[Environment], device: torch.device) -> None:
        self._envs, self._device = envs, device
        self._seeds = [0] * len(envs)
        self._episodes, self._is_over = [0] * len(envs), [True] * len(envs)
        self._actions: list[list[NDArray[np.float32]]] = [[] for _ in envs]
        self._observations: list[NDArray[np.float32]] = [np.zeros(0, np.float32) for _ in envs]

    @property
    def size(self) -> int:
        """P."""
        return len(self._envs)

    @property
    def task(self) -> TaskDescription | None:
        """Of this project's environments."""
        return task_of(self._envs[0])

    @property
    def observation_space(self) -> Space:
        """Of the first, as of all."""
        return self._envs[0].observation_space

    @property
    def action_space(self) -> Space:
        """Of the first, as of all."""
        return self._envs[0].action_space

    def seed(self, seeds: Sequence[int]) -> None:
        """Begin the draws of each anew."""
        self._seeds, self._episodes = [*seeds], [0] * len(seeds)

    def begin(self, where: Tensor) -> Tensor:
        """Begin episodes."""
        for k in torch.nonzero(where)[:, 0].tolist():
            self._reset(k, self._episodes[k])
            self._episodes[k] += 1
        return self._tensor(self._observations)

    def announce(self, action: Tensor) -> None:
        """Send it to those that are not in this process."""
        for env, each in zip(self._envs, action.cpu().numpy(), strict=True):
            if isinstance(env, Asynchronous):
                env.begin(each)

    def step(self, action: Tensor) -> EnvironmentStep:
        """Act."""
        told = [self._step(k, each) for k, each in enumerate(action.cpu().numpy())]
        observation, *rest = (self._tensor(each) for each in zip(*told, strict=True))
        return EnvironmentStep(observation, rest[0], *(each.bool() for each in rest[1:3]), *rest[3:])

    def _step(self, k: int, action: NDArray[np.float32]) -> tuple[Any, ...]:
        if self._is_over[k]:  # it waits for the others
            return self._observations[k], 0.0, 1.0, 0.0, math.nan, math.nan, math.nan
        observation, reward, terminated, truncated, info = self._envs[k].step(action)
        self._is_over[k] = bool(terminated or truncated)
        self._actions[k].append(action)
        self._observations[k] = np.asarray(observation, dtype=np.float32)
        told = (float(info.get(name, math.nan)) for name in ("targets_reached", "violations", "risky"))
        return self._observations[k], float(reward), float(terminated), float(truncated), *told

    def _reset(self, k: int, episode: int) -> None:
        seed = int(np.random.SeedSequence([self._seeds[k], STREAM, episode]).generate_state(1)[0] >> 1)
        self._observations[k] = np.asarray(self._envs[k].reset(seed=seed)[0], dtype=np.float32)
        self._actions[k], self._is_over[k] = [], False

    def states(self) -> list[dict[str, Tensor]]:
        """The number of each episode, and its actions."""
        size = self._envs[0].action_space.shape[0]
        return [
            {
                "episode": torch.tensor([self._episodes[k]]),
                "actions": torch.from_numpy(np.array(self._actions[k], np.float32).reshape(1, -1, size)),
            }
            for k in range(self.size)
        ]

    def restore(self, states: Sequence[Mapping[str, Tensor]]) -> bool:
        """Take the actions of each episode again where that makes the same state, else leave it to a new episode."""
        self._episodes = [int(state["episode"]) for state in states]
        if not all(map(is_repeatable, self._envs)):
            return False
        for k, state in enumerate(states):
            self._reset(k, self._episodes[k] - 1)
            for action in state["actions"][0].numpy():
                self._step(k, action)
        return True

    def close(self) -> None:
        """Close them."""
        for env in self._envs:
            env.close()

    def _tensor(self, values: Any) -> Tensor:
        return torch.from_numpy(np.array(values)).to(self._device)


def task_of(env: Environment) -> TaskDescription | None:
    """The task of one of this project's environments, else None."""
    task = getattr(env.unwrapped, "task", None)
    return task if isinstance(task, TaskDescription) else None
