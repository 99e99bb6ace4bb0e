"""Measures of how far actions of several passes or members lie apart (Eq. 4.39)."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.arrays import namespace
from torch import Tensor

Array = NDArray[Any] | Tensor
"""Of numpy on the host, whose small operations take a third of the time; of torch on a device."""


class Quartiles(NamedTuple):
    """How the actions of each seed lie, each of shape (P, n).

    Attributes:
        low: first quartile with linear interpolation.
        high: third quartile.
        mean: of all.
    """

    low: Any
    high: Any
    mean: Any


def quartiles(actions: Array) -> Quartiles:
    """Quartiles and mean over N actions, shape (P, N, n), as weighted sums of the ordered values in float64.

    A matrix product of one seed is summed in another order than several: one seed would differ from one of many.
    """
    if isinstance(actions, Tensor):
        ordered: Any = actions.sort(dim=1).values
        weights: Any = torch.from_numpy(_weights(actions.shape[1])).to(actions.device)
    else:
        ordered, weights = np.sort(actions, axis=1), _weights(actions.shape[1])
    sums = (weights * ordered[:, None]).sum(axis=2)  # (P, 3, n)
    return Quartiles(sums[:, 0], sums[:, 1], sums[:, 2])


@cache
def _weights(count: int) -> NDArray[np.float64]:
    """What each of the ordered values counts in the two quartiles and in the mean, shape (3, N, 1)."""
    weights = np.zeros((3, count, 1))
    for row, share in zip(weights, (0.25, 0.75), strict=False):
        place = share * (count - 1)
        below = int(place)
        row[below] = 1.0 - (place - below)
        row[min(below + 1, count - 1)] += place - below
    weights[2] = 1.0 / count
    return weights


def qcd(low: Any, high: Any) -> Any:
    """Quartile coefficient of dispersion, u_t = (1/Ω) Σ |(q₃ − q₁)/(q₃ + q₁)| (Eq. 4.39), shape (P,).

    It has no bound: it explodes where the quartiles lie around zero, which is where the robot is nearly at rest.
    Two quartiles at zero are no dispersion.
    """
    xp, apart = namespace(low), high - low
    with np.errstate(divide="ignore", invalid="ignore"):
        dispersion = abs(apart / (high + low))
    return xp.where(apart == 0.0, 0.0, dispersion).sum(axis=1) / low.shape[1]


def iqr(low: Any, high: Any) -> Any:
    """Interquartile range over the action range of 2, averaged over the action's components: between 0 and 1."""
    return (high - low).sum(axis=1) / (2.0 * low.shape[1])


MEASURES: Mapping[str, Callable[[Any, Any], Any]] = {"qcd": qcd, "iqr": iqr}
