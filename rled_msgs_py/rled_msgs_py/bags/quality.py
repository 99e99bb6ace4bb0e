"""How good a demonstration is, from its motion alone.

The score lies between 0 and 1: the share of targets reached, times the geometric mean of four marks,

- directness: 1 / detour, the length of the path over the straight line;
- smoothness: 1 / (1 + jerk / Δq_max), the jerk as change of the displacement's change, per tick and joint;
- presence: 1 − the share of steps in which the robot is idle;
- agreement: 1 − contradiction.

Motion is measured over the steps that the task counts. A hold, a tick at which nobody commanded in real time, is no
part of what was demonstrated.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.episodes import Episode, Segment
from rled_msgs_py.bags.series import Floats
from rled_msgs_py.bags.timeline import Timeline
from rled_msgs_py.messages import NANOSECONDS
from rled_msgs_py.task import TaskDescription

IDLE = 0.01
"""Share of Δq_max below which no joint counts as moving."""
NEIGHBOURS = 5
NEAR = 0.1
"""Root mean square distance, in half ranges of each observation, within which states are near."""
MAX_STATES = 4000
"""States that others are compared with; of more, evenly spread ones are taken."""
BLOCK = 256


class Quality(NamedTuple):
    """Measures of one episode.

    Attributes:
        reached: share of its targets that were reached (1).
        detour: length of the path over the straight lines, in joint or task space, whichever is straighter (1).
        jerk: root mean square of the third derivative of the joint angles (rad/s³).
        idle: share of steps in which nothing moves (1).
        contradiction: mean distance of the normalised displacements of near states of other segments (1).
        score: all of it, 0 to 1.
    """

    reached: float
    detour: float
    jerk: float
    idle: float
    contradiction: float
    score: float


def qualities(task: TaskDescription, timeline: Timeline, found: list[Episode]) -> list[Quality]:
    """Measure each episode; one without a segment scores 0."""
    far = contradictions(task, timeline, found)
    return [_quality(task, timeline, episode, far) for episode in found]


def contradictions(task: TaskDescription, timeline: Timeline, found: list[Episode]) -> Floats:
    """How far the displacements of near states are from each tick's, NaN where there are none, shape (k,).

    The distance is the Euclidean one over its maximum: 0 for equal displacements, 1 for opposite corners.
    """
    segment_of = np.full(len(timeline.moments), -1)
    for number, segment in enumerate(segment for episode in found for segment in episode.segments):
        segment_of[segment.first : segment.last] = number
    rows = np.flatnonzero((segment_of >= 0) & timeline.answered)
    lower, upper = task.observation_bounds()
    half = np.maximum((upper - lower) / 2.0, 1e-9)
    states = task.observe(timeline.q[rows], timeline.position[rows], timeline.target[rows]) / half
    actions = timeline.action[rows] / (2.0 * task.max_delta * np.sqrt(task.action_size))
    far = np.full(len(timeline.moments), np.nan)
    others = np.arange(0, len(rows), max(1, -(-len(rows) // MAX_STATES)))
    for start in range(0, len(rows), BLOCK):
        block = slice(start, start + BLOCK)
        far[rows[block]] = _distances(states, actions, segment_of[rows], others, block)
    return far


def _distances(
    states: Floats, actions: Floats, segment_of: NDArray[np.int64], others: NDArray[np.int64], block: slice
) -> Floats:
    apart = _apart(states[block], states[others])  # (b, o)
    apart[segment_of[block][:, None] == segment_of[others]] = np.inf
    nearest = np.argpartition(apart, min(NEIGHBOURS, len(others) - 1), axis=1)[:, :NEIGHBOURS]  # (b, 5)
    near = np.take_along_axis(apart, nearest, axis=1) < NEAR
    differences = np.linalg.norm(actions[block][:, None] - actions[others][nearest], axis=2)
    count = near.sum(axis=1)
    total = np.where(near, differences, 0.0).sum(axis=1)
    mean: Floats = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return mean


def _apart(left: Floats, right: Floats) -> Floats:
    """Root mean square distances of points, shape (b, o)."""
    squares = (left**2).sum(axis=1)[:, None] + (right**2).sum(axis=1) - 2.0 * left @ right.T
    apart: Floats = np.sqrt(np.maximum(squares, 0.0) / left.shape[1])
    return apart


def _quality(task: TaskDescription, timeline: Timeline, episode: Episode, far: Floats) -> Quality:
    if not episode.segments:
        return Quality(0.0, 1.0, 0.0, 1.0, 0.0, 0.0)
    segments = [_steps(timeline, segment) for segment in episode.segments]
    reached = float(np.mean([segment.reached for segment in episode.segments]))
    detour = min(_detour([values[rows] for rows in segments]) for values in (timeline.q, timeline.position))
    skips = [np.flatnonzero(np.diff(timeline.step[rows]) > 1) + 1 for rows in segments]
    pieces = [piece for rows, at in zip(segments, skips, strict=True) for piece in np.split(rows, at)]
    third = [np.diff(timeline.q[piece], 3, axis=0) for piece in pieces if len(piece) > 3]
    jerk = float(np.sqrt(np.mean(np.concatenate(third) ** 2))) if third else 0.0
    steps = np.concatenate([np.abs(np.diff(timeline.q[rows], axis=0)).max(axis=1) for rows in segments])
    idle = float(np.mean(steps < IDLE * task.max_delta)) if len(steps) else 0.0
    own = np.concatenate([far[segment.first : segment.last] for segment in episode.segments])
    contradiction = float(np.nanmean(own)) if not np.isnan(own).all() else 0.0
    marks = 1.0 / detour, 1.0 / (1.0 + jerk / task.max_delta), 1.0 - idle, 1.0 - contradiction
    score = reached * float(np.prod(np.clip(marks, 0.0, 1.0)) ** (1.0 / len(marks)))
    per_second = jerk / (task.period / NANOSECONDS) ** 3
    return Quality(reached, detour, per_second, idle, contradiction, score)


def _steps(timeline: Timeline, segment: Segment) -> NDArray[np.intp]:
    """The rows of a segment between which the task counted a step: of ticks that repeat it, the last."""
    rows = np.arange(segment.first, segment.last + 1)
    counts = np.diff(timeline.step[rows]) != 0
    return rows[np.append(counts, True)] if counts.any() else rows


def _detour(paths: list[Floats]) -> float:
    """Length of paths over the straight lines between their ends; at least 1."""
    length = sum(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in paths)
    straight = sum(float(np.linalg.norm(path[-1] - path[0])) for path in paths)
    if length <= 1e-9:
        return 1.0
    return max(1.0, length / max(straight, 1e-9))
