"""Whole episodes of a fixed policy in a Gymnasium environment."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray


class EpisodeResult(NamedTuple):
    """What one episode came to.

    Attributes:
        reward: sum of rewards (1).
        steps: transitions.
        targets_reached: of ``info``, NaN where the environment tells none.
        violations: of ``info``, likewise.
    """

    reward: float = 0.0
    steps: int = 0
    targets_reached: float = math.nan
    violations: float = math.nan

    def after(self, reward: float, info: Mapping[str, Any]) -> "EpisodeResult":
        """The same after one more transition."""
        counts = (float(info.get(name, math.nan)) for name in ("targets_reached", "violations"))
        return EpisodeResult(self.reward + reward, self.steps + 1, *counts)


def roll_out(
    env: gymnasium.Env[Any, Any], act: Callable[[NDArray[Any]], NDArray[Any]], episodes: int, seed: int
) -> list[EpisodeResult]:
    """Run episodes of ``act`` (observation to action, physical units), seeded one after the other from ``seed``."""
    return [_episode(env, act, seed + k) for k in range(episodes)]


def _episode(env: gymnasium.Env[Any, Any], act: Callable[[NDArray[Any]], NDArray[Any]], seed: int) -> EpisodeResult:
    observation, _ = env.reset(seed=seed)
    result, over = EpisodeResult(), False
    while not over:
        observation, reward, terminated, truncated, info = env.step(act(observation))
        result, over = result.after(float(reward), info), terminated or truncated
    return result


def mean_result(results: list[EpisodeResult]) -> dict[str, float]:
    """Means by field, of those that the environment tells."""
    means = {name: float(np.mean([getattr(each, name) for each in results])) for name in EpisodeResult._fields}
    return {name: mean for name, mean in means.items() if not math.isnan(mean)}
