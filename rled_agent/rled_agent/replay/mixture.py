"""Batches mixed of several buffers by share."""

from typing import Any, NamedTuple

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
            part = slice(begin, begin + count)
            sampler.update_priorities(indices[:, part], td_error[:, part])
            begin += count

    def state_dict(self) -> dict[str, Any]:
        """Of the further buffers; that of the first is kept as the replay's."""
        states = ((k, each.sampler.state_dict()) for k, each in enumerate(self._others))
        return {f"{k}.{name}": value for k, state in states for name, value in state.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is of other buffers.
        """
        for k, each in enumerate(self._others):
            own = {name.removeprefix(f"{k}."): value for name, value in state.items() if name.startswith(f"{k}.")}
            each.sampler.load_state_dict(own)
