"""One step of experience, and batches of them."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
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
    """One transition as it happens, normalised.

    Attributes:
        observation: s, shape (o,).
        action: a, shape (n,).
        reward: r.
        discount: γ, or 0 where the task ended, so that no value follows; γ where the episode was only cut.
        next_observation: s', shape (o,).
        source: who acted.
        is_last: whether the episode ends with it, for whichever reason.
    """

    observation: NDArray[np.float32]
    action: NDArray[np.float32]
    reward: float
    discount: float
    next_observation: NDArray[np.float32]
    source: Source = Source.AGENT
    is_last: bool = False


class Transitions(NamedTuple):
    """A batch of b transitions in normalised units, on any device.

    A transition over n steps, and one that was drawn with a priority, are of the same kind.

    Attributes:
        observation: s, shape (b, o).
        action: a, shape (b, n).
        reward: the discounted sum of the rewards of its steps, shape (b, 1).
        discount: what the value of s' counts: γⁿ (1 − terminated), shape (b, 1).
        next_observation: s', shape (b, o).
        source: a ``Source``, shape (b, 1).
        weight: of its error in a loss, 1 where all count the same, shape (b, 1).
        indices: its place in the buffer that it was drawn from, shape (b,).
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
        """1 where a person or a demonstration shows what to do, shape (b, 1)."""
        return (self.source >= Source.HUMAN).to(self.reward)


def concatenated(parts: list[Transitions]) -> Transitions:
    """Several batches as one, in order."""
    return parts[0] if len(parts) == 1 else Transitions(*map(torch.cat, zip(*parts, strict=True)))
