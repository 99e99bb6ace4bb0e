"""What the commands wrote of their runs, read as figures."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeVar

from rled_msgs_py.errors import RledError

from rled_agent.evaluation import Course
from rled_agent.experiments.archive import KeptRun, Runs
from rled_agent.experiments.experiment import Drawing
from rled_agent.experiments.statistics import Floats
from rled_agent.expert import CurvePoint
from rled_agent.rollout import EpisodeResult

T = TypeVar("T")
DRAWN = ("success", "steps", "path_length", "jerk")
"""Figures of a band that are drawn or told."""


def read_experts(drawing: Drawing, variants: Runs) -> list[float]:
    """What the cloned expert of each run of the first variant came to, by the actor's metric."""
    name = drawing.metric.removeprefix("evaluation_")
    return [_read(run, "expert", lambda values: _number(values[name])) for run in next(iter(variants.values()))]


def read_cloning(run: KeptRun) -> Mapping[str, Floats]:
    """Learning curve of an expert."""
    return run.columns("curve", *CurvePoint._fields)


def read_bands(run: KeptRun) -> dict[str, dict[str, dict[str, float]]]:
    """What ``evaluate_agent`` found: band, policy, figure; NaN for one that there is none of."""
    score = partial(_figures, DRAWN, _number_or_nan)
    return _read(run, "evaluation", lambda bands: _each(bands, lambda policies: _each(policies, score)))


def read_episodes(run: KeptRun) -> dict[str, dict[str, float]]:
    """What ``evaluate_agent`` found in whole episodes: policy, figure."""
    score = partial(_figures, EpisodeResult._fields, _number)
    return _read(run, "episodes", lambda policies: {name: score(policies[name]) for name in ("expert", "agent")})


def read_courses(run: KeptRun, band: str) -> dict[str, list[Course]]:
    """Motions that ``evaluate_agent`` kept of a band, by policy."""
    return _read(run, "motions", lambda bands: _each(bands[band], _courses))


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
        raise RledError(what, "figures of a run", "make it again") from None


def _each(values: dict[str, Any], take: Callable[[Any], T]) -> dict[str, T]:
    if not values:
        raise ValueError("it is empty")
    return {name: take(each) for name, each in values.items()}


def _figures(names: tuple[str, ...], take: Callable[[Any], T], values: dict[str, Any]) -> dict[str, T]:
    return {name: take(values[name]) for name in names}


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{str(value)[:40]} for a number")
    return float(value)


def _number_or_nan(value: Any) -> float:
    return math.nan if value is None else _number(value)


def _courses(group: Any) -> list[Course]:
    if not group:
        raise ValueError("no motions")
    return [*map(_course, group)]


def _course(values: Any) -> Course:
    course = Course(*([*map(_number, each)] for each in values))
    if len(course.change) != max(len(course.distance) - 2, 0):
        raise ValueError(f"{len(course.change)} changes along {len(course.distance)} distances")
    return course
