"""Measures of how far actions of several passes or members lie apart (Eq. 4.39)."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import NamedTuple

import torch
from torch import Tensor


class Quartiles(NamedTuple):
    """How the actions of each seed lie, each of shape (P, n).

    Attributes:
        low: first quartile with linear interpolation.
        high: third quartile.
        mean: of all.
    """

    low: Tensor
    high: Tensor
    mean: Tensor


def quartiles(actions: Tensor) -> Quartiles:
    """Quartiles and mean over N actions, shape (P, N, n), as weighted sums of the ordered values.

    A matrix product of one seed is summed in another order than several: one seed would differ from one of many.
    """
    ordered = actions.sort(dim=1).values.double()
    weights = _weights(actions.shape[1], actions.device)
    return Quartiles(*(weights * ordered[:, None]).sum(dim=2).unbind(dim=1))


@cache
def _weights(count: int, device: torch.device) -> Tensor:
    """What each of the ordered values counts in the two quartiles and in the mean, shape (3, N, 1)."""
    weights = torch.zeros(3, count, dtype=torch.float64)
    for row, share in zip(weights, (0.25, 0.75), strict=False):
        place = share * (count - 1)
        below = int(place)
        row[below] = 1.0 - (place - below)
        row[min(below + 1, count - 1)] += place - below
    weights[2] = 1.0 / count
    return weights[:, :, None].to(device)


def qcd(low: Tensor, high: Tensor) -> Tensor:
    """Quartile coefficient of dispersion, u_t = (1/Ω) Σ |(q₃ − q₁)/(q₃ + q₁)| (Eq. 4.39), shape (P,).

    It has no bound: it explodes where the quartiles lie around zero, which is where the robot is nearly at rest.
    Two quartiles at zero are no dispersion.
    """
    apart = high - low
    dispersion = (apart / (high + low)).abs()
    return torch.where(apart == 0.0, 0.0, dispersion).mean(dim=1)


def iqr(low: Tensor, high: Tensor) -> Tensor:
    """Interquartile range over the action range of 2, averaged over the action's components: between 0 and 1."""
    return (high - low).mean(dim=1) / 2.0


MEASURES: Mapping[str, Callable[[Tensor, Tensor], Tensor]] = {"qcd": qcd, "iqr": iqr}
