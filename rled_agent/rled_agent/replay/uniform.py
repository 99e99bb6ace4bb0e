"""The uniform replay buffer: one row of one array per transition, so that a batch is one gather."""

import os
from typing import Any

import numpy as np
import torch
from rled_msgs_py.errors import RledError
from torch import Tensor

from rled_agent.nn.draws import Draws
from rled_agent.replay.replay import Replay
from rled_agent.replay.transitions import Step, Transitions, transitions_of

MAX_BYTES = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
"""Of a replay: half of the machine's memory."""


class UniformReplay(Replay):
    """A ring of transitions for each seed, each as likely to be drawn as the other.

    All seeds hold as many: they take their steps together.

    Args:
        observation_size: o.
        action_size: n.
        capacity: transitions kept of each seed; then the oldest are overwritten.
        draws: draws; everything is on its device.

    Raises:
        RledError: half of this machine's memory would not hold them.
    """

    def __init__(self, observation_size: int, action_size: int, capacity: int, draws: Draws) -> None:
        self.observation_size, self.action_size, self.capacity = observation_size, action_size, capacity
        self.draws = draws
        self.added = 0
        shape = (draws.population, capacity, 2 * observation_size + action_size + 3)
        bytes_taken = 4 * shape[0] * shape[1] * shape[2]
        if bytes_taken > MAX_BYTES:
            what = f"a replay of {shape[0] * capacity:,} transitions takes {bytes_taken / 2**30:,.1f} GiB"
            raise RledError(what, f"{MAX_BYTES / 2**30:,.1f} GiB at most", "lower schedule.capacity")
        self.rows = _untouched(shape) if draws.device.type == "cpu" else torch.zeros(shape, device=draws.device)
        self._flat = self.rows.view(-1, shape[2])
        self._first = torch.arange(draws.population, device=draws.device)[:, None] * capacity  # (P, 1)

    def __len__(self) -> int:
        """Transitions held of each seed."""
        return min(self.added, self.capacity)

    def add(self, step: Step) -> None:
        """Store one step of an episode of each seed."""
        self.rows[:, self.added % self.capacity] = step.rows()
        self.added += 1

    def extend(self, transitions: Transitions) -> None:
        """Store transitions, in order."""
        rows = transitions.rows()[:, -self.capacity :]
        places = (self.added + torch.arange(rows.shape[1], device=rows.device)) % self.capacity
        self.rows[:, places] = rows
        self.added += rows.shape[1]

    def sample(self, size: int) -> Transitions:
        """Draw transitions uniformly, with replacement."""
        return self.at(self.draws.integers(len(self), size))

    def at(self, index: Tensor) -> Transitions:
        """The transitions of each seed at some places, shape (P, b)."""
        places = (index + self._first).view(-1)
        rows = torch.index_select(self._flat, 0, places).view(*index.shape, -1)
        return transitions_of(rows, self.observation_size, self.action_size, index)

    def state_dict(self) -> dict[str, Any]:
        """All transitions, and how many there were."""
        return {"rows": self.rows[:, : len(self)], "added": self.added}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: transitions of other sizes, or not as many as were added.
        """
        rows, added = state["rows"], state["added"]
        held = (len(self.rows), min(added, self.capacity), self.rows.shape[2])
        if tuple(rows.shape) != held:
            raise RledError(f"a replay of shape {tuple(rows.shape)} after {added} steps", str(held))
        self.rows[:, : held[1]] = rows
        self.added = added


def _untouched(shape: tuple[int, ...]) -> Tensor:
    """Zeros that take memory as they are written: PyTorch's own take all of it at once."""
    return torch.from_numpy(np.zeros(shape, dtype=np.float32))
