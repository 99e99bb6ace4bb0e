"""What the commands wrote of their runs, read as metrics."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeVar

from rled_msgs_py.errors import RledError

from rled_agent.experiments.archive import KeptRun, Runs
from rled_agent.experiments.experiment import Drawing
from rled_agent.experiments.statistics import Floats
from rled_agent.learners.cloning import CurvePoint
from rled_agent.training.evaluation import Trace
from rled_agent.training.rollout import EpisodeResult

T = TypeVar("T")
DRAWN_METRICS = ("success", "steps", "path_length", "jerk")
"""Figures of a distance bin that are drawn or told."""


def read_experts(drawing: Drawing, variants: Runs) -> list[float]:
    """What the cloned expert of each run of the first variant came to, by the actor's metric."""
    name = drawing.metric.removeprefix("evaluation_")
    return [_read(run, "expert", lambda values: _number(values[name])) for run in next(iter(variants.values()))]


def read_cloning(run: KeptRun) -> Mapping[str, Floats]:
    """Learning curve of an expert."""
    return run.columns("curve", *CurvePoint._fields)


def read_bins(run: KeptRun) -> dict[str, dict[str, dict[str, float]]]:
    """What ``evaluate_agent`` found: distance bin, policy, metric; NaN for one that there is none of."""
    score = partial(_metrics, DRAWN_METRICS, _number_or_nan)
    return _read(run, "evaluation", lambda bins: _each(bins, lambda policies: _each(policies, score)))


def read_episodes(run: KeptRun) -> dict[str, dict[str, float]]:
    """What ``evaluate_agent`` found in whole episodes: policy, metric."""
    score = partial(_metrics, EpisodeResult._fields, _number)
    return _read(run, "episodes", lambda policies: {name: score(policies[name]) for name in ("expert", "agent")})


def read_traces(run: KeptRun, group: str) -> dict[str, list[Trace]]:
    """Motions that ``evaluate_agent`` kept of a distance bin, by policy."""
    return _read(run, "motions", lambda bins: _each(bins[group], _traces))


def _read(run: KeptRun, document: str, take: Callable[[Any], T]) -> T:
    """What is in a document, once it is looked through.

    Raises:
        RledError: it is not kept, or holds something else.
    """
    try:
        return take(run.documents[document])
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
        why = f"no {error}" if isinstance(error, LookupError) else str(error)[:200]
        what = f"the {document} of {run.name} is not as it was written ({why})"
        raise RledError(what, "metrics of a run", "make it again") from None


def _each(values: dict[str, Any], take: Callable[[Any], T]) -> dict[str, T]:
    if not values:
        raise ValueError("it is empty")
    return {name: take(each) for name, each in values.items()}


def _metrics(names: tuple[str, ...], take: Callable[[Any], T], values: dict[str, Any]) -> dict[str, T]:
    return {name: take(values[name]) for name in names}


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{str(value)[:40]} for a number")
    return float(value)


def _number_or_nan(value: Any) -> float:
    return math.nan if value is None else _number(value)


def _traces(group: Any) -> list[Trace]:
    if not group:
        raise ValueError("no motions")
    return [*map(_trace, group)]


def _trace(values: Any) -> Trace:
    trace = Trace(*([*map(_number, each)] for each in values))
    if len(trace.change) != max(len(trace.distance) - 2, 0):
        raise ValueError(f"{len(trace.change)} changes along {len(trace.distance)} distances")
    return trace
