"""Which units a stochastic pass drops."""

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Generator = torch.Generator | np.random.Generator
"""NumPy's draws three times as fast, PyTorch's is the one that a learner draws everything from."""


def dropout_masks(shapes: Sequence[tuple[int, ...]], probability: float, generator: Generator) -> list[Tensor]:
    """Inverted dropout: 0 with ``probability``, else the reciprocal of the probability to stay.

    One draw serves all masks, and four units share one of its 64-bit words, several times faster than a Bernoulli draw
    each; the probability is met to 2⁻¹⁶.
    """
    if isinstance(generator, torch.Generator) and generator.device.type != "cpu":
        return [_drawn(shape, probability, generator) for shape in shapes]
    ends = list(accumulate(map(math.prod, shapes), initial=0))
    dropped = round(probability * 2**16)
    draws = _words((ends[-1] + 3) // 4, generator).view(np.uint16)
    factors = (draws >= dropped).astype(np.float32)  # NumPy is several times as fast as PyTorch on small integers
    factors *= np.float32(2**16 / (2**16 - dropped))
    parts = zip(pairwise(ends), shapes, strict=True)
    return [torch.from_numpy(factors[start:end].reshape(shape)) for (start, end), shape in parts]


def _drawn(shape: tuple[int, ...], probability: float, generator: torch.Generator) -> Tensor:
    """A mask that is made on the generator's device."""
    kept = torch.rand(shape, generator=generator, device=generator.device) >= probability
    return kept / (1.0 - probability)


def _words(count: int, generator: Generator) -> NDArray[np.integer]:
    """64-bit words whose bits are all random."""
    if isinstance(generator, np.random.Generator):
        return generator.bit_generator.random_raw(count)
    return torch.empty(count, dtype=torch.int64).random_(-(2**63), None, generator=generator).numpy()
