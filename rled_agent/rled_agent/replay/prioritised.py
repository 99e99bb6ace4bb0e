"""Prioritised replay (Schaul et al., 2016): transitions of greater error are drawn more often, and weigh less."""

from typing import Any

import torch
from rled_msgs_py.errors import RledError
from torch import Tensor

from rled_agent.replay.replay import Replay
from rled_agent.replay.transitions import Step, Transitions
from rled_agent.replay.uniform import UniformReplay

TINY = torch.finfo(torch.float64).tiny


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
        self._levels = max(replay.capacity - 1, 1).bit_length()
        self._leaves = 1 << self._levels
        seeds, device = replay.draws.population, replay.draws.device
        # a tree for each seed: node k is the sum of 2k and 2k + 1, the leaves are last
        self._sums = torch.zeros(seeds, 2 * self._leaves, dtype=torch.float64, device=device)
        self._greatest = torch.ones(seeds, dtype=torch.float64, device=device)

    def __len__(self) -> int:
        """Transitions held of each seed."""
        return len(self._replay)

    def add(self, step: Step) -> None:
        """Store one step of an episode, of the greatest priority."""
        place = torch.full((len(self._sums), 1), self._replay.added % self._replay.capacity, device=self._sums.device)
        self._set(place, self._greatest[:, None])
        self._replay.add(step)

    def extend(self, transitions: Transitions) -> None:
        """Store transitions, in order, of the greatest priority."""
        count = min(transitions.reward.shape[1], self._replay.capacity)
        places = (self._replay.added + torch.arange(count, device=self._sums.device)) % self._replay.capacity
        self._set(places.expand(len(self._sums), -1), self._greatest[:, None].expand(-1, count))
        self._replay.extend(transitions)

    def sample(self, size: int) -> Transitions:
        """Draw transitions by their priorities, one from each of ``size`` equal parts of their sum."""
        total = self._sums[:, 1:2]
        parts = torch.arange(size, device=total.device) + self._replay.draws.uniform(size).double()
        chosen = self._find(parts / size * total)
        chance = self._sums.gather(1, self._leaves + chosen) / total
        weight = _power(len(self) * chance, -self._beta)
        drawn = self._replay.at(chosen)
        return drawn._replace(weight=(weight / weight.amax(dim=1, keepdim=True)).to(drawn.reward)[..., None])

    def update_priorities(self, indices: Tensor, td_error: Tensor) -> None:
        """Take the errors of the last batch as its priorities; one that is drawn twice has its greater error."""
        priority = td_error.abs().double() + self._epsilon
        self._greatest = torch.maximum(self._greatest, priority.amax(dim=1))
        self._set(indices, priority)

    def state_dict(self) -> dict[str, Any]:
        """Of the transitions, and their priorities."""
        leaves = self._sums[:, self._leaves : self._leaves + len(self)]
        return self._replay.state_dict() | {"priorities": leaves, "greatest": self._greatest}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is of another buffer, or priorities are missing or negative.
        """
        leaves, greatest = state["priorities"], state["greatest"]
        if leaves.shape != state["rows"].shape[:2] or not (leaves >= 0.0).all() or (leaves.sum(dim=1) == 0.0).any():
            accepted = "one for each transition, 0 or more, not all of them 0"
            raise RledError(f"priorities of shape {tuple(leaves.shape)}", accepted)
        if greatest.shape != self._greatest.shape or not (greatest > 0.0).all():
            raise RledError(f"{str(greatest.tolist())[:40]} as the greatest priority", "a number above 0 for each seed")
        self._replay.load_state_dict(state)
        self._greatest = greatest.to(self._greatest)
        self._sums.zero_()
        self._set_raised(torch.arange(len(self)).expand(len(self._sums), -1).to(self._sums.device), leaves)

    def _set(self, index: Tensor, priority: Tensor) -> None:
        self._set_raised(index, _power(priority, self._alpha))

    def _set_raised(self, index: Tensor, raised: Tensor) -> None:
        node = self._leaves + index  # (P, k)
        self._sums.scatter_(1, node, 0.0)
        self._sums.scatter_reduce_(1, node, raised, "amax")  # the same on every device, whichever of two comes last
        for _ in range(self._levels):
            node = node // 2
            self._sums.scatter_(1, node, self._sums.gather(1, 2 * node) + self._sums.gather(1, 2 * node + 1))

    def _find(self, sums: Tensor) -> Tensor:
        """The transitions that running sums of priorities lie in, shape (P, b)."""
        node = torch.ones_like(sums, dtype=torch.int64)
        for _ in range(self._levels):
            node = 2 * node
            left = self._sums.gather(1, node)
            right = (sums >= left) & (self._sums.gather(1, node + 1) > 0.0)
            sums = torch.where(right, sums - left, sums)
            node = node + right
        return (node - self._leaves).clamp(max=len(self) - 1)


def _power(numbers: Tensor, exponent: float) -> Tensor:
    """Powers of numbers of 0 or more, where 0 counts as the least there is above it.

    ``torch.pow`` rounds what is left over behind the last vector of a processor otherwise than what lies within one,
    so a seed's numbers would depend on how many seeds lie behind each other.
    """
    return (numbers.clamp(min=TINY).log_() * exponent).exp_()
