"""Episodes seen from outside: what ticks add up to."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.tick import Tick


@dataclass
class Episode:
    """One episode, as far as it was watched.

    Attributes:
        number: episode counter of the task.
        targets_reached: of the newest tick.
        violations: of the newest tick.
        steps: of the newest tick.
        reward: sum of rewards seen (1).
        path: end-effector positions (m).
        targets: distinct targets (m), in order.
        finished: a terminal tick was seen.
    """

    number: int
    targets_reached: int = 0
    violations: int = 0
    steps: int = 0
    reward: float = 0.0
    path: list[NDArray[np.float64]] = field(default_factory=list)
    targets: list[NDArray[np.float64]] = field(default_factory=list)
    finished: bool = False

    def add(self, tick: Tick) -> None:
        """Take the next tick of this episode."""
        status = tick.status
        self.targets_reached, self.violations, self.steps = status.targets_reached, status.violations, status.step
        self.reward += status.reward
        self.path.append(tick.ee.position)
        if not self.targets or not np.array_equal(self.targets[-1], tick.target.position):
            self.targets.append(tick.target.position)
        self.finished = status.terminated or status.truncated


class EpisodeLog:
    """Sorts ticks into episodes.

    Args:
        wanted: episodes after which the log is full.
    """

    def __init__(self, wanted: int) -> None:
        self.wanted = wanted
        self.finished: list[Episode] = []
        self._current: Episode | None = None

    @property
    def full(self) -> bool:
        """As many episodes as wanted have ended."""
        return len(self.finished) >= self.wanted

    def add(self, tick: Tick) -> bool:
        """Take a tick; an episode counts when its last tick is seen, and only if its first was seen too.

        Returns:
            Whether an episode ended with it.
        """
        if self._current is None or self._current.number != tick.status.episode:
            self._current = Episode(tick.status.episode) if tick.status.step == 0 else None
        if self._current is None or self.full:
            return False
        self._current.add(tick)
        ended = self._current.finished
        if ended:
            self.finished.append(self._current)
            self._current = None
        return ended
