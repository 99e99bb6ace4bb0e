"""Prioritised replay (Schaul et al., 2016): transitions of greater error are drawn more often, and weigh less."""

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from torch import Tensor

from rled_agent.replay.replay import Replay
from rled_agent.replay.transitions import Step, Transitions
from rled_agent.replay.uniform import UniformReplay

Array = NDArray[Any]


class PrioritisedReplay(Replay):
    """Draws transition i with probability p_i^α / Σ p^α, weighted by (N P(i))^−β over the greatest weight.

    p_i = |δ_i| + ε is the error found last; a new transition has the greatest there was, so that it is drawn soon.

    Args:
        replay: what keeps the transitions.
        alpha: α, 0 draws uniformly.
        beta: β, 1 corrects all of what drawing unevenly does to the expectation.
        epsilon: ε, so that no transition is forgotten.
    """

    def __init__(self, replay: UniformReplay, alpha: float = 0.6, beta: float = 0.4, epsilon: float = 1e-3) -> None:
        self._replay, self._alpha, self._beta, self._epsilon = replay, alpha, beta, epsilon
        self._leaves = 1 << max(replay.capacity - 1, 1).bit_length()
        self._sums = np.zeros(2 * self._leaves)  # a tree: node k is the sum of 2k and 2k + 1, the leaves are last
        self._greatest = 1.0

    def __len__(self) -> int:
        """Transitions held."""
        return len(self._replay)

    def add(self, step: Step) -> None:
        """Store one step of an episode, of the greatest priority."""
        self._set(np.array([self._replay.added % self._replay.capacity]), np.array([self._greatest]))
        self._replay.add(step)

    def extend(self, transitions: Transitions) -> None:
        """Store transitions, in order, of the greatest priority."""
        first, count = self._replay.added, min(len(transitions.reward), self._replay.capacity)
        self._set((first + np.arange(count)) % self._replay.capacity, np.full(count, self._greatest))
        self._replay.extend(transitions)

    def sample(self, size: int) -> Transitions:
        """Draw transitions by their priorities, one from each of ``size`` equal parts of their sum."""
        generator = self._replay.generator
        parts = np.arange(size) + torch.rand(size, generator=generator, device=generator.device).cpu().numpy()
        chosen = self._find(parts / size * self._sums[1])
        chance = self._sums[self._leaves + chosen] / self._sums[1]
        weight = (len(self) * chance) ** -self._beta
        drawn = self._replay.at(torch.from_numpy(chosen).to(generator.device))
        return drawn._replace(weight=torch.from_numpy(weight / weight.max()).to(drawn.reward)[:, None])

    def update_priorities(self, indices: Tensor, td_error: Tensor) -> None:
        """Take the errors of the last batch as its priorities."""
        priority = (td_error.abs() + self._epsilon).cpu().numpy().astype(np.float64)
        self._greatest = max(self._greatest, float(priority.max()))
        self._set(indices.cpu().numpy(), priority)

    def state_dict(self) -> dict[str, Any]:
        """Of the transitions, and their priorities."""
        leaves = torch.from_numpy(self._sums[self._leaves : self._leaves + len(self)])
        return self._replay.state_dict() | {"priorities": leaves, "greatest": self._greatest}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is of another buffer, or priorities are missing or negative.
        """
        leaves, greatest = state["priorities"].numpy(), state["greatest"]
        if leaves.shape != state["rows"].shape[:1] or not (leaves >= 0.0).all() or (len(leaves) and not leaves.any()):
            raise RledError(
                f"priorities of shape {leaves.shape}", "one for each transition, 0 or more, not all of them 0"
            )
        if not isinstance(greatest, float) or not 0.0 < greatest < math.inf:
            raise RledError(f"{str(greatest)[:40]} as the greatest priority", "a number above 0")
        self._replay.load_state_dict(state)
        self._greatest = greatest
        self._sums[:] = 0.0
        self._set_raised(np.arange(len(self)), leaves)

    def _set(self, index: Array, priority: Array) -> None:
        self._set_raised(index, priority**self._alpha)

    def _set_raised(self, index: Array, raised: Array) -> None:
        node = self._leaves + index
        self._sums[node] = raised
        while node.size and node[0] > 1:  # all of them are equally deep
            node = np.unique(node // 2)
            self._sums[node] = self._sums[2 * node] + self._sums[2 * node + 1]

    def _find(self, sums: Array) -> Array:
        """The transitions that running sums of priorities lie in, shape (b,)."""
        node = np.ones(len(sums), dtype=np.int64)
        while node[0] < self._leaves:
            node *= 2
            right = (sums >= self._sums[node]) & (self._sums[node + 1] > 0.0)
            sums = np.where(right, sums - self._sums[node], sums)
            node += right
        return np.minimum(node - self._leaves, len(self) - 1)
