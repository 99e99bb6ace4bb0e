"""Action uncertainty from Monte-Carlo dropout (Eq. 4.38, 4.39)."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from rled_agent.networks import Network

Measure = Literal["qcd", "iqr"]


class Estimate(NamedTuple):
    """What N stochastic passes say of one state.

    Attributes:
        mean: a_MC (Eq. 4.38), normalised, shape (n,).
        uncertainty: u_t by measure (1).
    """

    mean: NDArray[np.float32]
    uncertainty: dict[Measure, float]


def quartiles(actions: NDArray[np.floating]) -> tuple[list[float], list[float]]:
    """First and third quartile over the passes, with linear interpolation: (N, n) -> n each."""
    ordered = np.sort(actions, axis=0)
    low, high = (_interpolate(ordered, share * (len(ordered) - 1)) for share in (0.25, 0.75))
    return low, high


def _interpolate(ordered: NDArray[np.floating], place: float) -> list[float]:
    below = int(place)
    above = min(below + 1, len(ordered) - 1)
    pairs = zip(ordered[below].tolist(), ordered[above].tolist(), strict=True)  # a few numbers: quicker than arrays
    return [a + (place - below) * (b - a) for a, b in pairs]


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


MEASURES: Mapping[Measure, Callable[[Sequence[float], Sequence[float]], float]] = {"qcd": qcd, "iqr": iqr}


class MonteCarlo:
    """N stochastic passes of an actor, in one batch.

    Args:
        actor: its dropped units make the passes differ.
        passes: N.
        generator: draws the dropped units.
    """

    def __init__(self, actor: Network, passes: int, generator: torch.Generator) -> None:
        self._actor, self._passes, self._generator = actor, passes, generator

    def __call__(self, observation: NDArray[np.float32]) -> Estimate:
        """Mean action and uncertainty in one state, normalised, shape (o,)."""
        rows = torch.from_numpy(observation).expand(self._passes, -1)
        actions = self._actor.forward(rows, generator=self._generator)[0].numpy()  # (N, n)
        low, high = quartiles(actions)
        uncertainty = {name: measure(low, high) for name, measure in MEASURES.items()}
        return Estimate(actions.mean(axis=0), uncertainty)
