"""The replay buffer: one row of one array per transition, so that a batch is one gather."""

import os
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from torch import Tensor

MOST_BYTES = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
"""Of a replay: half of the machine's memory."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Transitions in normalised units, as rows (s, a, r, terminated, s').

    Attributes:
        rows: shape (b, 2o + n + 2).
        observation_size: o.
        action_size: n.
        demonstrated: the last this many rows were drawn from the demonstrations.
    """

    rows: Tensor
    observation_size: int
    action_size: int
    demonstrated: int = 0

    def __len__(self) -> int:
        """B, the number of transitions."""
        return self.rows.shape[0]

    @cached_property
    def pair(self) -> Tensor:
        """(s, a) side by side, shape (b, o + n)."""
        return self.rows[:, : self.observation_size + self.action_size]

    @cached_property
    def observation(self) -> Tensor:
        """S, shape (b, o)."""
        return self.rows[:, : self.observation_size]

    @cached_property
    def action(self) -> Tensor:
        """A, shape (b, n)."""
        return self.rows[:, self.observation_size : self.observation_size + self.action_size]

    @cached_property
    def reward(self) -> Tensor:
        """R, shape (b, 1)."""
        start = self.observation_size + self.action_size
        return self.rows[:, start : start + 1]

    @cached_property
    def terminated(self) -> Tensor:
        """1 where the task ended, so that no value follows, shape (b, 1); a truncated episode is 0 here."""
        start = self.observation_size + self.action_size + 1
        return self.rows[:, start : start + 1]

    @cached_property
    def next_observation(self) -> Tensor:
        """S', shape (b, o)."""
        return self.rows[:, -self.observation_size :]


class Replay:
    """A ring of transitions.

    Args:
        observation_size: o.
        action_size: n.
        capacity: transitions kept; then the oldest are overwritten.

    Raises:
        RledError: half of this machine's memory would not hold them.
    """

    def __init__(self, observation_size: int, action_size: int, capacity: int) -> None:
        self.observation_size, self.action_size, self.capacity = observation_size, action_size, capacity
        self.added = 0
        width = 2 * observation_size + action_size + 2
        if capacity * width * 4 > MOST_BYTES:
            what = f"a replay of {capacity:,} transitions takes {capacity * width * 4 / 2**30:,.1f} GiB"
            raise RledError(what, f"{MOST_BYTES / 2**30:,.1f} GiB at most", "lower schedule.capacity")
        self.rows = np.zeros((capacity, width), dtype=np.float32)
        self._tensor = torch.from_numpy(self.rows)
        self._drawn: dict[int, tuple[Tensor, Batch]] = {}

    def __len__(self) -> int:
        """Transitions held."""
        return min(self.added, self.capacity)

    def add(
        self,
        observation: NDArray[np.float32],
        action: NDArray[np.float32],
        reward: float,
        terminated: bool,
        next_observation: NDArray[np.float32],
    ) -> None:
        """Store one transition, normalised."""
        o, n = self.observation_size, self.action_size
        row = self.rows[self.added % self.capacity]
        row[:o] = observation
        row[o : o + n] = action
        row[o + n] = reward
        row[o + n + 1] = terminated
        row[o + n + 2 :] = next_observation
        self.added += 1

    def extend(self, rows: NDArray[np.float32]) -> None:
        """Store transitions, shape (k, 2o + n + 2), in order."""
        for row in rows:
            self.rows[self.added % self.capacity] = row
            self.added += 1

    def sample(self, size: int, generator: torch.Generator) -> Batch:
        """Draw transitions uniformly, with replacement, into memory that the next call of this size overwrites."""
        chosen, batch = self._drawn.get(size) or self._memory(size)
        torch.index_select(self._tensor, 0, chosen.random_(len(self), generator=generator), out=batch.rows)
        return batch

    def _memory(self, size: int) -> tuple[Tensor, Batch]:
        batch = Batch(
            torch.empty(size, self.rows.shape[1], dtype=torch.float32), self.observation_size, self.action_size
        )
        self._drawn[size] = torch.empty(size, dtype=torch.int64), batch
        return self._drawn[size]
