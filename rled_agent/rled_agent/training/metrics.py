"""Metrics of training between two rows of ``metrics.csv``."""

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np
from rled_msgs_py.records import Actor

from rled_agent.exploration.strategy import Choice
from rled_agent.learners.learner import Update
from rled_agent.training.rollout import EpisodeResult, mean_result


class MetricsAccumulator:
    """What happened since the last row.

    Attributes:
        episodes: those that ended.
        updates: what each gradient step reported, not yet read back.
    """

    def __init__(self) -> None:
        self.episodes: list[EpisodeResult] = []
        self.updates: list[Update] = []
        self._steps = self._demonstrated = 0
        self._risky: list[bool] = []
        self._min_reward = np.inf
        self._uncertainty: dict[str, list[float]] = defaultdict(list)

    def count(self, choice: Choice, reward: float, info: Mapping[str, Any]) -> None:
        """Take one environment step."""
        self._steps += 1
        self._demonstrated += choice.actor is Actor.EXPERT
        if "risky" in info:
            self._risky.append(bool(info["risky"]))
        self._min_reward = min(self._min_reward, reward)
        for name, value in choice.uncertainty.items():
            self._uncertainty[name].append(value)

    def row(self, has_expert: bool) -> dict[str, float]:
        """Metrics by name; there is none of what the task or the method does not have.

        Args:
            has_expert: whether an expert might have acted.
        """
        row = mean_result(self.episodes) if self.episodes else {}
        row |= {"episodes": float(len(self.episodes)), "lowest_reward": self._min_reward}
        if has_expert:
            row["demonstrated_share"] = self._demonstrated / max(self._steps, 1)
        if self._risky:
            row["violations_per_1000"] = 1000.0 * float(np.mean(self._risky))
        for name, values in self._uncertainty.items():
            row[f"{name}_mean"], row[f"{name}_median"] = float(np.mean(values)), float(np.median(values))
        return row | self._losses()

    def _losses(self) -> dict[str, float]:
        """Mean over the gradient steps of each of their metrics."""
        names = self.updates[-1].metrics if self.updates else ()
        return {name: float(np.mean([float(each.metrics[name].mean()) for each in self.updates])) for name in names}
