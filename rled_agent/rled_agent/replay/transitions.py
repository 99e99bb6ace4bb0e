"""One step of experience, and batches of them."""

from enum import IntEnum
from typing import NamedTuple

import torch
from torch import Tensor


class Source(IntEnum):
    """Where a transition comes from."""

    AGENT = 0
    """The learned policy acted."""
    EXPERT = 1
    """The cloned expert acted in its place while it learned."""
    HUMAN = 2
    """A person acted in its place while it learned."""
    DEMONSTRATION = 3
    """It was demonstrated before."""


class Step(NamedTuple):
    """One transition of each of P seeds as it happens, normalised.

    Attributes:
        observation: s, shape (P, o).
        action: a, shape (P, n).
        reward: r, shape (P,).
        discount: γ, or 0 where the task ended, so that no value follows; γ where the episode was only cut, shape (P,).
        next_observation: s', shape (P, o).
        source: who acted, a ``Source``, shape (P,).
        is_last: whether the episode ends with it, for whichever reason, shape (P,).
    """

    observation: Tensor
    action: Tensor
    reward: Tensor
    discount: Tensor
    next_observation: Tensor
    source: Tensor
    is_last: Tensor

    def rows(self) -> Tensor:
        """All but the last as one row a seed, shape (P, 2 o + n + 3), as replays keep them."""
        columns = (each[:, None] for each in (self.reward, self.discount))
        return torch.cat(
            (self.observation, self.action, *columns, self.next_observation, self.source[:, None]), dim=1
        )  # fmt: skip


class Transitions(NamedTuple):
    """A batch of b transitions for each of P seeds, in normalised units, on any device.

    A transition over n steps, and one that was drawn with a priority, are of the same kind.

    Attributes:
        observation: s, shape (P, b, o).
        action: a, shape (P, b, n).
        reward: the discounted sum of the rewards of its steps, shape (P, b, 1).
        discount: what the value of s' counts: γⁿ (1 − terminated), shape (P, b, 1).
        next_observation: s', shape (P, b, o).
        source: a ``Source``, shape (P, b, 1).
        weight: of its error in a loss, 1 where all count the same, shape (P, b, 1).
        indices: its place in the buffer that it was drawn from, shape (P, b).
    """

    observation: Tensor
    action: Tensor
    reward: Tensor
    discount: Tensor
    next_observation: Tensor
    source: Tensor
    weight: Tensor
    indices: Tensor

    @property
    def demonstrated(self) -> Tensor:
        """1 where a person or a demonstration shows what to do, shape (P, b, 1)."""
        return (self.source >= Source.HUMAN).to(self.reward)

    def rows(self) -> Tensor:
        """What a replay keeps of them, shape (P, b, 2 o + n + 3)."""
        return torch.cat(self[:6], dim=2)


def transitions_of(rows: Tensor, observation_size: int, action_size: int, indices: Tensor) -> Transitions:
    """The transitions of rows, shape (P, b, 2 o + n + 3), all of one weight."""
    sizes = (observation_size, action_size, 1, 1, observation_size, 1)
    weight = rows.new_ones(1).expand(*rows.shape[:2], 1)
    columns: tuple[Tensor, ...] = (*rows.split(sizes, dim=2), weight, indices)
    return Transitions(*columns)


def concatenated(parts: list[Transitions]) -> Transitions:
    """Several batches as one, in order."""
    if len(parts) == 1:
        return parts[0]
    return Transitions(*(torch.cat(columns, dim=1) for columns in zip(*parts, strict=True)))
