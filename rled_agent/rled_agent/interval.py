"""Figures of training between two rows of ``metrics.csv``."""

from dataclasses import dataclass, field

import numpy as np
from rled_msgs_py.records import Actor

from rled_agent.behaviour import Choice
from rled_agent.learners.td3 import Metrics
from rled_agent.rollout import EpisodeResult, mean_result
from rled_agent.uncertainty import Measure


@dataclass
class Interval:
    """What happened since the last row.

    Attributes:
        episodes: those that ended.
        steps: environment steps.
        demonstrated: steps in which the expert acted.
        violations: risky states entered.
        lowest_reward: least reward of a step.
        uncertainty: u_t of each step, by measure.
        updates: metrics of each gradient step, not yet read back.
    """

    episodes: list[EpisodeResult] = field(default_factory=list)
    steps: int = 0
    demonstrated: int = 0
    violations: int = 0
    lowest_reward: float = np.inf
    uncertainty: dict[Measure, list[float]] = field(default_factory=lambda: {"qcd": [], "iqr": []})
    updates: list[Metrics] = field(default_factory=list)

    def count(self, choice: Choice, reward: float, risky: bool) -> None:
        """Take one environment step."""
        self.steps += 1
        self.demonstrated += choice.actor is Actor.EXPERT
        self.violations += risky
        self.lowest_reward = min(self.lowest_reward, reward)
        for name, value in choice.uncertainty.items():
            self.uncertainty[name].append(value)

    def row(self) -> dict[str, float]:
        """Figures by name; NaN where there was nothing to count."""
        nothing = dict.fromkeys(EpisodeResult._fields, np.nan)
        row = mean_result(self.episodes) if self.episodes else nothing
        row |= {
            "episodes": float(len(self.episodes)),
            "demonstrated_share": self.demonstrated / max(self.steps, 1),
            "violations_per_1000": 1000.0 * self.violations / max(self.steps, 1),
            "lowest_reward": self.lowest_reward,
        }
        for name, values in self.uncertainty.items():
            row[f"{name}_mean"] = float(np.mean(values)) if values else np.nan
            row[f"{name}_median"] = float(np.median(values)) if values else np.nan
        return row | self._losses()

    def _losses(self) -> dict[str, float]:
        names = ("critic_loss", "q")
        return {name: float(np.mean([getattr(each, name) for each in self.updates] or [np.nan])) for name in names}
