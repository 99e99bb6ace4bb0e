"""The uniform replay buffer: one row of one array per transition, so that a batch is one gather."""

import os
from typing import Any

import numpy as np
import torch
from rled_msgs_py.errors import RledError
from torch import Tensor

from rled_agent.replay.replay import Replay
from rled_agent.replay.transitions import Step, Transitions

MAX_BYTES = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
"""Of a replay: half of the machine's memory."""


class UniformReplay(Replay):
    """A ring of transitions, each as likely to be drawn as the other.

    Args:
        observation_size: o.
        action_size: n.
        capacity: transitions kept; then the oldest are overwritten.
        generator: draws; batches are on its device.

    Raises:
        RledError: half of this machine's memory would not hold them.
    """

    def __init__(self, observation_size: int, action_size: int, capacity: int, generator: torch.Generator) -> None:
        self.observation_size, self.action_size, self.capacity = observation_size, action_size, capacity
        self.generator = generator
        self.added = 0
        width = 2 * observation_size + action_size + 3
        if capacity * width * 4 > MAX_BYTES:
            what = f"a replay of {capacity:,} transitions takes {capacity * width * 4 / 2**30:,.1f} GiB"
            raise RledError(what, f"{MAX_BYTES / 2**30:,.1f} GiB at most", "lower schedule.capacity")
        self.rows = np.zeros((capacity, width), dtype=np.float32)
        self._tensor = torch.from_numpy(self.rows)
        self._sizes = (observation_size, action_size, 1, 1, observation_size, 1)

    def __len__(self) -> int:
        """Transitions held."""
        return min(self.added, self.capacity)

    def add(self, step: Step) -> None:
        """Store one step of an episode."""
        o, n = self.observation_size, self.action_size
        row = self.rows[self.added % self.capacity]
        row[:o] = step.observation
        row[o : o + n] = step.action
        row[o + n] = step.reward
        row[o + n + 1] = step.discount
        row[o + n + 2 : -1] = step.next_observation
        row[-1] = step.source
        self.added += 1

    def extend(self, transitions: Transitions) -> None:
        """Store transitions, in order."""
        rows = torch.cat([*transitions[:6]], dim=1).cpu().numpy()
        for row in rows[-self.capacity :]:
            self.rows[self.added % self.capacity] = row
            self.added += 1

    def sample(self, size: int) -> Transitions:
        """Draw transitions uniformly, with replacement."""
        device = self.generator.device
        return self.at(torch.empty(size, dtype=torch.int64, device=device).random_(len(self), generator=self.generator))

    def at(self, index: Tensor) -> Transitions:
        """The transitions at some places, shape (b,)."""
        rows = torch.index_select(self._tensor, 0, index.cpu()).to(index.device)
        observation, action, reward, discount, following, source = rows.split(self._sizes, dim=1)
        weight = torch.ones(len(index), 1, device=index.device)
        return Transitions(observation, action, reward, discount, following, source, weight, index)

    def state_dict(self) -> dict[str, Any]:
        """All transitions, and how many there were."""
        return {"rows": self._tensor[: len(self)], "added": self.added}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: transitions of other sizes, or not as many as were added.
        """
        rows, added = state["rows"], state["added"]
        if rows.ndim != 2 or rows.shape[1] != self.rows.shape[1] or len(rows) != min(added, self.capacity):
            raise RledError(f"a replay of shape {tuple(rows.shape)} after {added} steps", str(self.rows.shape))
        self._tensor[: len(rows)] = rows
        self.added = added
