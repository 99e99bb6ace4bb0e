"""What is plotted of the learner and its gate: sums over episodes, and the newest decisions, none of it without end."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateDecision
from rled_msgs_py.tick import Tick

EPISODES, DECISIONS = 300, 500
"""How many of each are kept."""


class EpisodePoint(NamedTuple):
    """One episode that has ended.

    Attributes:
        number: as the task counts.
        total: undiscounted return (1).
        targets: reached.
        demonstrated: share of its decisions in which the expert or a person acted, NaN without decisions.
    """

    number: int
    total: float
    targets: int
    demonstrated: float


class Curves:
    """Follows ticks and decisions in their order."""

    def __init__(self) -> None:
        self._episodes: deque[EpisodePoint] = deque(maxlen=EPISODES)
        self._decisions: deque[tuple[float, float, float]] = deque(maxlen=DECISIONS)
        self._number, self._total, self._targets = -1, 0.0, 0
        self._acts = self._demonstrated = 0

    def add_tick(self, tick: Tick) -> None:
        """Count a tick; the first of another episode ends the one before."""
        status = tick.status
        if status.episode != self._number:
            self._end()
            self._number, self._total, self._targets = status.episode, 0.0, 0
        self._total += status.reward
        self._targets = max(self._targets, status.targets_reached)

    def add_decision(self, decision: GateDecision) -> None:
        """Count a decision of the gate."""
        self._acts += 1
        self._demonstrated += decision.actor in (Actor.EXPERT, Actor.HUMAN)
        if not math.isnan(decision.uncertainty):
            self._decisions.append((decision.stamp * 1e-9, decision.uncertainty, decision.threshold))

    def episodes(self) -> tuple[NDArray[np.float64], ...]:
        """Number, return, targets and demonstrated share of the episodes, each of shape (k,)."""
        return tuple(np.array(list(self._episodes), dtype=np.float64).reshape(-1, 4).T)

    def decisions(self) -> tuple[NDArray[np.float64], ...]:
        """Time (s), uncertainty and threshold of the newest decisions, each of shape (k,)."""
        return tuple(np.array(list(self._decisions), dtype=np.float64).reshape(-1, 3).T)

    def _end(self) -> None:
        if self._number >= 0:
            share = self._demonstrated / self._acts if self._acts else math.nan
            self._episodes.append(EpisodePoint(self._number, self._total, self._targets, share))
        self._acts = self._demonstrated = 0
