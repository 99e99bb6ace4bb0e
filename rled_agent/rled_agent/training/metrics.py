"""Metrics of training between two rows of ``metrics.csv``."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rled_agent.exploration.strategy import Choice
from rled_agent.learners.learner import Update
from rled_agent.training.environment_batch import EnvironmentStep
from rled_agent.training.rollout import EpisodeResult, mean_result

Array = NDArray[Any]


class MetricsAccumulator:
    """What happened since the last row, of each seed; nothing is read back from the device before ``rows``.

    Attributes:
        updates: what each gradient step reported.
    """

    def __init__(self) -> None:
        self.updates: list[Update] = []
        self._steps: list[EnvironmentStep] = []
        self._by_expert: list[Tensor] = []
        self._results: list[tuple[Tensor, Tensor]] = []
        self._uncertainty: list[Mapping[str, Tensor]] = []

    def count(self, choice: Choice, step: EnvironmentStep, episode_return: Tensor, episode_steps: Tensor) -> None:
        """Take one environment step, and what its episode has come to, shape (P,) each."""
        self._steps.append(step)
        self._by_expert.append(choice.by_expert)
        self._results.append((episode_return, episode_steps))
        self._uncertainty.append(choice.uncertainty)

    def rows(self, has_expert: bool) -> list[dict[str, float]]:
        """Metrics by name, of each seed; there is none of what the task or the method does not have.

        Args:
            has_expert: whether an expert might have acted.
        """
        losses, episodes = self._losses(), self.episodes()
        risky, reward = (_stacked([getattr(each, name) for each in self._steps]) for name in ("risky", "reward"))
        by_expert = _stacked(self._by_expert)
        estimated = {name: _stacked([each[name] for each in self._uncertainty]) for name in self._uncertainty[-1]}
        rows = []
        for k, ended in enumerate(episodes):
            row = mean_result(ended) if ended else {}
            row |= {"episodes": float(len(ended)), "lowest_reward": float(reward[:, k].min())}
            if has_expert:
                row["demonstrated_share"] = float(by_expert[:, k].mean())
            if not np.isnan(risky[:, k]).all():
                row["violations_per_1000"] = 1000.0 * float(risky[:, k].mean())
            for name, values in estimated.items():
                row[f"{name}_mean"], row[f"{name}_median"] = float(values[:, k].mean()), float(np.median(values[:, k]))
            rows.append(row | {name: float(values[k]) for name, values in losses.items()})
        return rows

    def episodes(self) -> list[list[EpisodeResult]]:
        """Those that ended, of each seed."""
        over = _stacked([each.terminated | each.truncated for each in self._steps]).astype(bool)  # (T, P)
        returns, steps = (_stacked([each[k] for each in self._results]) for k in range(2))
        told = [_stacked([getattr(each, name) for each in self._steps]) for name in ("targets_reached", "violations")]
        return [
            [
                EpisodeResult(returns[t, k], int(steps[t, k]), told[0][t, k], told[1][t, k])
                for t in np.flatnonzero(over[:, k])
            ]
            for k in range(over.shape[1])
        ]

    def _losses(self) -> dict[str, Array]:
        """Mean over the gradient steps of each of their metrics, shape (P,)."""
        names = self.updates[-1].metrics if self.updates else ()
        return {
            name: _stacked([each.metrics[name].flatten(1).mean(dim=1) for each in self.updates]).mean(axis=0)
            for name in names
        }


def _stacked(columns: list[Tensor]) -> Array:
    """Of shape (P,) each, as (T, P)."""
    stacked: Array = torch.stack(columns).double().cpu().numpy()
    return stacked
