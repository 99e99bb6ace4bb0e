"""Batches mixed of several buffers by share."""

from typing import NamedTuple

from torch import Tensor

from rled_agent.replay.replay import Sampler
from rled_agent.replay.transitions import Transitions, concatenated


class Part(NamedTuple):
    """A buffer of a mixture.

    Attributes:
        sampler: the buffer.
        share: of each batch, while there is something in it.
    """

    sampler: Sampler
    share: float


class Mixture(Sampler):
    """Draws a share of each batch from each further buffer and the rest from the first (RLPD, Ball et al., 2023).

    Args:
        first: gives what the others do not.
        others: the further buffers; an empty one gives nothing.
    """

    def __init__(self, first: Sampler, *others: Part) -> None:
        self._first, self._others = first, others
        self._drawn: list[tuple[Sampler, int]] = []

    def __len__(self) -> int:
        """Transitions held."""
        return len(self._first) + sum(len(each.sampler) for each in self._others)

    def sample(self, size: int) -> Transitions:
        """Draw transitions: those of the first buffer first."""
        counts = [round(size * each.share) if len(each.sampler) else 0 for each in self._others]
        wanted = [(self._first, size - sum(counts))]
        wanted += [(each.sampler, count) for each, count in zip(self._others, counts, strict=True)]
        self._drawn = [(sampler, count) for sampler, count in wanted if count]
        return concatenated([sampler.sample(count) for sampler, count in self._drawn])

    def update_priorities(self, indices: Tensor, td_error: Tensor) -> None:
        """Give each buffer the errors of what was drawn from it."""
        begin = 0
        for sampler, count in self._drawn:
            sampler.update_priorities(indices[begin : begin + count], td_error[begin : begin + count])
            begin += count
