"""Action uncertainty from Monte-Carlo dropout (Eq. 4.38, 4.39)."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.validation import Range, check_fields

from rled_agent.bounds import Amount
from rled_agent.nn.dropout import Generator
from rled_agent.nn.perceptron import Perceptron

Measure = Literal["qcd", "iqr"]
Passes = Annotated[int, Range(2, 10_000)]


@dataclass(frozen=True)
class GateSettings:
    """What Eq. 4.40 compares; a policy that learned behind the gate carries them.

    Attributes:
        measure: u_t.
        threshold: ξ; at this uncertainty or more the expert acts.
        passes: N.
    """

    measure: Measure = "qcd"
    threshold: Amount = 1e-3
    passes: Passes = 30

    def __post_init__(self) -> None:
        check_fields(self)

    def __str__(self) -> str:
        return f"{self.measure}, threshold {self.threshold:g}, {self.passes} passes"


class Estimate(NamedTuple):
    """What N stochastic passes say of one state.

    Attributes:
        mean: a_MC (Eq. 4.38), normalised, shape (n,).
        uncertainty: u_t by measure (1).
    """

    mean: NDArray[np.float32]
    uncertainty: dict[Measure, float]


class Spread(NamedTuple):
    """How the passes' actions lie.

    Attributes:
        low: first quartile with linear interpolation, n numbers.
        high: third quartile.
        mean: shape (n,).
    """

    low: list[float]
    high: list[float]
    mean: NDArray[np.float64]


def spread(actions: NDArray[np.floating]) -> Spread:
    """Quartiles and mean over the passes, shape (N, n), in one product with the ordered values."""
    low, high, mean = _weights(len(actions)) @ np.sort(actions, axis=0)
    return Spread(low.tolist(), high.tolist(), mean)


@cache
def _weights(passes: int) -> NDArray[np.float64]:
    """What each of the ordered values counts in the two quartiles and in the mean, shape (3, N)."""
    weights = np.zeros((3, passes))
    for row, share in zip(weights, (0.25, 0.75), strict=False):
        place = share * (passes - 1)
        below = int(place)
        row[below] = 1.0 - (place - below)
        row[min(below + 1, passes - 1)] += place - below
    weights[2] = 1.0 / passes
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


MEASURES: Mapping[Measure, Callable[[Sequence[float], Sequence[float]], float]] = {"qcd": qcd, "iqr": iqr}


class MonteCarlo:
    """N stochastic passes of an actor, in one batch.

    Args:
        actor: its dropped units make the passes differ.
        passes: N.
        generator: draws the dropped units.
    """

    def __init__(self, actor: Perceptron, passes: int, generator: Generator) -> None:
        self._actor, self._passes, self._generator = actor, passes, generator

    def __call__(self, observation: NDArray[np.float32]) -> Estimate:
        """Mean action and uncertainty in one state, normalised, shape (o,)."""
        with torch.inference_mode():
            actions = self._actor.forward_once(torch.from_numpy(observation), self._passes, self._generator)
        low, high, mean = spread(actions.numpy()[0])  # (N, n)
        return Estimate(mean.astype(np.float32), {name: measure(low, high) for name, measure in MEASURES.items()})
