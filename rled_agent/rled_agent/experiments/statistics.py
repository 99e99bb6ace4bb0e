"""Figures of runs that differ in their seed only."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, trim_mean

Floats = NDArray[np.float64]
RESAMPLES = 2_000
CONFIDENCE = 0.95
END = 0.2
"""Last part of a curve that counts as where it ended."""


class Curve(NamedTuple):
    """A metric over environment steps.

    Attributes:
        steps: shape (k,).
        values: shape (k,), none of them NaN.
    """

    steps: Floats
    values: Floats

    def smoothed(self, window: int) -> "Curve":
        """Means over so many points."""
        if window <= 1 or len(self.values) < window:
            return self
        kernel = np.full(window, 1.0 / window)
        return Curve(self.steps[window - 1 :], np.convolve(self.values, kernel, mode="valid"))

    @property
    def end(self) -> float:
        """Mean of the last fifth."""
        return float(self.values[-max(1, round(END * len(self.values))) :].mean())

    @property
    def mean(self) -> float:
        """Of all points: the higher, the sooner it rose."""
        return float(self.values.mean())

    def first_step(self, level: float) -> float:
        """Steps until the metric is at a level for the first time, infinite if it never is."""
        there = self.steps[self.values >= level]
        return float(there[0]) if len(there) else np.inf


class Estimate(NamedTuple):
    """Interquartile mean over seeds with the bounds of its 95 % bootstrap interval (Agarwal et al., 2021)."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3g} ({self.low:.3g} to {self.high:.3g})"


def read_columns(path: Path) -> dict[str, Floats]:
    """The columns of a CSV file of numbers, by name."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in (rows[0] if rows else {})}


def read_curve(path: Path, metric: str) -> Curve:
    """One metric of ``metrics.csv``, where it was measured."""
    columns = read_columns(path)
    measured = np.isfinite(columns[metric])
    return Curve(columns["step"][measured], columns[metric][measured])


def estimate(values: Sequence[float]) -> Estimate:
    """Interquartile mean of one value a seed."""
    sample = np.asarray(values, dtype=np.float64)
    middle = float(_middle(sample))
    if len(sample) < 2 or np.ptp(sample) == 0.0 or not np.isfinite(sample).all():
        return Estimate(middle, middle, middle)
    found = bootstrap(
        (sample.tolist(),),
        _middle,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Estimate(middle, float(found.low), float(found.high))


def _middle(values: Any, axis: int = -1) -> Any:
    return trim_mean(values, 0.25, axis=axis)


def common(curves: Sequence[Curve]) -> tuple[Floats, Floats]:
    """Steps that all curves have, shape (k,), and the values there, shape (curves, k)."""
    steps = curves[0].steps
    for curve in curves[1:]:
        steps = np.intersect1d(steps, curve.steps)
    values = [curve.values[np.searchsorted(curve.steps, steps)] for curve in curves]
    return steps, np.stack(values)
