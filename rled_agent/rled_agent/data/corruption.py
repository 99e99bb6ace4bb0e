"""Demonstrations made worse on purpose, to see what poor ones cost (section 3.5.2)."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.validation import Range, check_fields

from rled_agent.bounds import Seed, Share


@dataclass(frozen=True)
class Corruption:
    """How poor the demonstrations are made; not at all by default."""

    tremor: Annotated[float, Range(0, 10)] = 0.0
    """std of noise on each demonstrated displacement, as a share of Δq_max"""
    wrong: Share = 0.0
    """share of the motions that do not lead to the target that they were shown for"""
    seed: Seed = 0
    """of which motions are wrong"""

    def __post_init__(self) -> None:
        check_fields(self)

    def shaken(
        self, action: NDArray[np.float64], max_delta: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """Displacements (rad) of a trembling hand, within Δq_max.

        Args:
            action: intended displacements (rad), shape (k, n).
            max_delta: Δq_max (rad).
            generator: draws the tremor; nothing is drawn from it for a hand that does not tremble.
        """
        if not self.tremor:
            return action
        return np.clip(action + generator.normal(0.0, self.tremor * max_delta, action.shape), -max_delta, max_delta)

    def goals_shown(self, points: int) -> NDArray[np.int64]:
        """For each ordered pair of points, in row order, the point that was shown as its target, shape (points²,)."""
        generator = np.random.default_rng(self.seed)
        goals = np.tile(np.arange(points), points)
        wrong = generator.random(points**2) < self.wrong
        others = generator.integers(1, points, size=int(wrong.sum()))
        goals[wrong] = (goals[wrong] + others) % points
        return goals


NO_CORRUPTION = Corruption()
