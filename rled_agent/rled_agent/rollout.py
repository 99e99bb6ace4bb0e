"""Whole episodes of a fixed policy in a Gymnasium environment."""

from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray


class EpisodeResult(NamedTuple):
    """What one episode came to.

    Attributes:
        reward: sum of rewards (1).
        steps: transitions.
        targets_reached: of ``info``, 0 where the environment tells none.
        violations: of ``info``, likewise.
    """

    reward: float
    steps: int
    targets_reached: int
    violations: int


def roll_out(
    env: gymnasium.Env[Any, Any], act: Callable[[NDArray[Any]], NDArray[Any]], episodes: int, seed: int
) -> list[EpisodeResult]:
    """Run episodes of ``act`` (observation to action, physical units), seeded one after the other from ``seed``."""
    return [_episode(env, act, seed + k) for k in range(episodes)]


def _episode(env: gymnasium.Env[Any, Any], act: Callable[[NDArray[Any]], NDArray[Any]], seed: int) -> EpisodeResult:
    observation, info = env.reset(seed=seed)
    total, steps, over = 0.0, 0, False
    while not over:
        observation, reward, terminated, truncated, info = env.step(act(observation))
        total, steps, over = total + float(reward), steps + 1, terminated or truncated
    return EpisodeResult(total, steps, int(info.get("targets_reached", 0)), int(info.get("violations", 0)))


def mean_result(results: list[EpisodeResult]) -> dict[str, float]:
    """Means by field."""
    return {name: float(np.mean([getattr(each, name) for each in results])) for name in EpisodeResult._fields}
