"""Random numbers of a population: those of a member do not depend on how many there are."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

GOLDEN, FIRST, SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB
"""Constants of SplitMix64 (Steele, Lea and Flood, 2014)."""
NINE, THIRTY_TWO, HALF, STEP = np.uint32(9), np.uint64(32), np.float32(0.5), np.float32(2.0**-23)
AHEAD = 2048
"""Words that the host makes at once: many draws are of a few numbers."""


class Draws:
    """What each of P members draws: the k-th word of a member is SplitMix64's hash of its seed and k.

    All members take the same number of words, whether they need them or not, so that one counter says where all of them
    are; it is all the state there is. The same words come on every device.

    Args:
        seeds: of the members.
        device: that tensors are made on.
        stream: tells several generators of one seed apart.

    Attributes:
        taken: words that each member has drawn.
    """

    def __init__(self, seeds: Sequence[int], device: str | torch.device = "cpu", stream: int = 0) -> None:
        self.seeds, self.device, self.taken = tuple(seeds), torch.device(device), 0
        keys = [np.random.SeedSequence([seed, stream]).generate_state(1, np.uint64) for seed in seeds]
        self._keys: NDArray[np.uint64] = np.stack(keys)  # (P, 1)
        self._device_keys = torch.from_numpy(self._keys.view(np.int64)).to(self.device)
        self._made, self._made_from = np.empty((len(keys), 0), dtype=np.uint64), 0

    @property
    def population(self) -> int:
        """P."""
        return len(self.seeds)

    def uniform(self, *shape: int) -> Tensor:
        """Numbers between 0 and 1, neither of them, shape (P, *shape): float32 in steps of 2⁻²³."""
        halves = self._halves(math.prod(shape))
        if isinstance(halves, Tensor):
            drawn = ((halves >> 9) & 0x7FFFFF).to(torch.float32).add_(0.5).mul_(2.0**-23)
        else:
            numbers = np.add(halves >> NINE, HALF, dtype=np.float32)
            numbers *= STEP
            drawn = torch.from_numpy(numbers)
        return drawn.view(self.population, *shape)

    def integers(self, high: int, *shape: int) -> Tensor:
        """Whole numbers of [0, high), high below 2³¹, shape (P, *shape), int64."""
        halves = self._halves(math.prod(shape))
        if isinstance(halves, Tensor):
            drawn = (halves.to(torch.int64) & 0xFFFFFFFF) * high >> 32
        else:
            drawn = torch.from_numpy((halves * np.uint64(high) >> THIRTY_TWO).view(np.int64))
        return drawn.view(self.population, *shape)

    def normal(self, *shape: int) -> Tensor:
        """Standard normal numbers, shape (P, *shape): float32, by the inverse of their distribution."""
        return self.uniform(*shape).mul_(2.0).sub_(1.0).erfinv_().mul_(math.sqrt(2.0))

    def skip(self, *shape: int) -> None:
        """Leave out what ``uniform`` or ``normal`` of a shape would draw, so that what follows is the same."""
        self.taken += (math.prod(shape) + 1) // 2

    def kept(self, probability: float, count: int) -> Tensor:
        """Inverted dropout: 0 with ``probability``, else the reciprocal of the probability to stay, shape (P, count).

        Four units share one word, several times faster than a draw each; the probability is met to 2⁻¹⁶.
        """
        dropped = round(probability * 2**16)
        factor = 2**16 / (2**16 - dropped)
        words = self._words((count + 3) // 4)
        if isinstance(words, Tensor):
            stays = (words.view(torch.int16)[:, :count].to(torch.int32) & 0xFFFF) >= dropped
            return stays.to(torch.float32).mul_(factor)
        factors = (words.view(np.uint16)[:, :count] >= dropped).astype(np.float32)  # NumPy is several times as fast
        factors *= np.float32(factor)
        return torch.from_numpy(factors)

    def _halves(self, count: int) -> NDArray[np.uint32] | Tensor:
        """Halves of words, shape (P, count): 32 bits each."""
        words = self._words((count + 1) // 2)
        if isinstance(words, Tensor):
            return words.view(torch.int32)[:, :count]
        halves: NDArray[np.uint32] = words.view(np.uint32)[:, :count]
        return halves

    def _words(self, count: int) -> Any:
        """The next words of each member, shape (P, count): of NumPy's uint64 on the host, of int64 on a device."""
        first, self.taken = self.taken, self.taken + count
        if self.device.type != "cpu":
            numbers = torch.arange(first + 1, first + 1 + count, device=self.device) * _signed(GOLDEN)
            return _mixed_on_device(self._device_keys + numbers)
        begin = first - self._made_from
        if begin < 0 or begin + count > self._made.shape[1]:
            self._made, self._made_from, begin = self._make(first, max(count, AHEAD)), first, 0
        return self._made[:, begin : begin + count]

    def _make(self, first: int, count: int) -> NDArray[np.uint64]:
        numbers = np.arange(first + 1, first + 1 + count, dtype=np.uint64)
        numbers *= np.uint64(GOLDEN)
        return _mixed(self._keys + numbers)


def _mixed(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    words ^= words >> np.uint64(30)
    words *= np.uint64(FIRST)
    words ^= words >> np.uint64(27)
    words *= np.uint64(SECOND)
    words ^= words >> np.uint64(31)
    return words


def _mixed_on_device(words: Tensor) -> Tensor:
    """The same with signed words, whose products overflow alike and whose shifts are masked."""
    words = (words ^ _shifted(words, 30)) * _signed(FIRST)
    words = (words ^ _shifted(words, 27)) * _signed(SECOND)
    mixed: Tensor = words ^ _shifted(words, 31)
    return mixed


def _shifted(words: Tensor, bits: int) -> Tensor:
    shifted: Tensor = (words >> bits) & (2 ** (64 - bits) - 1)
    return shifted


def _signed(word: int) -> int:
    return word - 2**64 if word >= 2**63 else word
