"""Measures of how far actions of several passes or members lie apart (Eq. 4.39)."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Quartiles(NamedTuple):
    """How the actions lie.

    Attributes:
        low: first quartile with linear interpolation, n numbers.
        high: third quartile.
        mean: shape (n,).
    """

    low: list[float]
    high: list[float]
    mean: NDArray[np.float64]


def quartiles(actions: NDArray[np.floating]) -> Quartiles:
    """Quartiles and mean over N actions, shape (N, n), in one product with the ordered values."""
    low, high, mean = _weights(len(actions)) @ np.sort(actions, axis=0)
    return Quartiles(low.tolist(), high.tolist(), mean)


@cache
def _weights(count: int) -> NDArray[np.float64]:
    """What each of the ordered values counts in the two quartiles and in the mean, shape (3, N)."""
    weights = np.zeros((3, count))
    for row, share in zip(weights, (0.25, 0.75), strict=False):
        place = share * (count - 1)
        below = int(place)
        row[below] = 1.0 - (place - below)
        row[min(below + 1, count - 1)] += place - below
    weights[2] = 1.0 / count
    return weights


def qcd(low: Sequence[float], high: Sequence[float]) -> float:
    """Quartile coefficient of dispersion, u_t = (1/Ω) Σ |(q₃ − q₁)/(q₃ + q₁)| (Eq. 4.39).

    It has no bound: it explodes where the quartiles lie around zero, which is where the robot is nearly at rest.
    Two quartiles at zero are no dispersion.
    """
    return sum(map(_dispersion, low, high)) / len(low)


def _dispersion(low: float, high: float) -> float:
    if low == high:
        return 0.0
    return abs(high - low) / abs(high + low) if high + low else math.inf


def iqr(low: Sequence[float], high: Sequence[float]) -> float:
    """Interquartile range over the action range of 2, averaged over the action's components: between 0 and 1."""
    return (sum(high) - sum(low)) / len(low) / 2.0


MEASURES: Mapping[str, Callable[[Sequence[float], Sequence[float]], float]] = {"qcd": qcd, "iqr": iqr}
