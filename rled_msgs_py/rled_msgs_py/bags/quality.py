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

from rled_msgs_py.bags.episodes import Episode, Leg
from rled_msgs_py.bags.series import Floats
from rled_msgs_py.bags.timeline import Timeline
from rled_msgs_py.messages import NANOSECONDS
from rled_msgs_py.task import TaskDescription

IDLE = 0.01
"""Share of Δq_max below which no joint counts as moving."""
NEIGHBOURS = 5
NEAR = 0.1
"""Root mean square distance, in half ranges of each observation, within which states are near."""
MOST_STATES = 4000
"""States that others are compared with; of more, evenly spread ones are taken."""
BLOCK = 256


class Quality(NamedTuple):
    """Measures of one episode.

    Attributes:
        reached: share of its targets that were reached (1).
        detour: length of the path over the straight lines, in joint or task space, whichever is straighter (1).
        jerk: root mean square of the third derivative of the joint angles (rad/s³).
        idle: share of steps in which nothing moves (1).
        contradiction: mean distance of the normalised displacements of near states of other ways to targets (1).
        score: all of it, 0 to 1.
    """

    reached: float
    detour: float
    jerk: float
    idle: float
    contradiction: float
    score: float


def qualities(task: TaskDescription, line: Timeline, found: list[Episode]) -> list[Quality]:
    """Measure each episode; one without a way to a target scores 0."""
    far = contradictions(task, line, found)
    return [_quality(task, line, episode, far) for episode in found]


def contradictions(task: TaskDescription, line: Timeline, found: list[Episode]) -> Floats:
    """How far the displacements of near states are from each tick's, NaN where there are none, shape (k,).

    The distance is the Euclidean one over its greatest value: 0 for equal displacements, 1 for opposite corners.
    """
    way = np.full(len(line.moments), -1)
    for number, leg in enumerate(leg for episode in found for leg in episode.legs):
        way[leg.first : leg.last] = number
    rows = np.flatnonzero((way >= 0) & line.answered)
    lower, upper = task.observation_bounds()
    half = np.maximum((upper - lower) / 2.0, 1e-9)
    states = task.observe(line.q[rows], line.position[rows], line.target[rows]) / half
    actions = line.action[rows] / (2.0 * task.max_delta * np.sqrt(task.action_size))
    far = np.full(len(line.moments), np.nan)
    others = np.arange(0, len(rows), max(1, -(-len(rows) // MOST_STATES)))
    for start in range(0, len(rows), BLOCK):
        block = slice(start, start + BLOCK)
        far[rows[block]] = _distances(states, actions, way[rows], others, block)
    return far


def _distances(
    states: Floats, actions: Floats, way: NDArray[np.int64], others: NDArray[np.int64], block: slice
) -> Floats:
    apart = _apart(states[block], states[others])  # (b, o)
    apart[way[block][:, None] == way[others]] = np.inf
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


def _quality(task: TaskDescription, line: Timeline, episode: Episode, far: Floats) -> Quality:
    if not episode.legs:
        return Quality(0.0, 1.0, 0.0, 1.0, 0.0, 0.0)
    ways = [_steps(line, leg) for leg in episode.legs]
    reached = float(np.mean([leg.reached for leg in episode.legs]))
    detour = min(_detour([values[way] for way in ways]) for values in (line.q, line.position))
    pieces = [piece for way in ways for piece in np.split(way, np.flatnonzero(np.diff(line.step[way]) > 1) + 1)]
    third = [np.diff(line.q[piece], 3, axis=0) for piece in pieces if len(piece) > 3]
    jerk = float(np.sqrt(np.mean(np.concatenate(third) ** 2))) if third else 0.0
    steps = np.concatenate([np.abs(np.diff(line.q[way], axis=0)).max(axis=1) for way in ways])
    idle = float(np.mean(steps < IDLE * task.max_delta)) if len(steps) else 0.0
    own = np.concatenate([far[leg.first : leg.last] for leg in episode.legs])
    contradiction = float(np.nanmean(own)) if not np.isnan(own).all() else 0.0
    marks = 1.0 / detour, 1.0 / (1.0 + jerk / task.max_delta), 1.0 - idle, 1.0 - contradiction
    score = reached * float(np.prod(np.clip(marks, 0.0, 1.0)) ** (1.0 / len(marks)))
    per_second = jerk / (task.period / NANOSECONDS) ** 3
    return Quality(reached, detour, per_second, idle, contradiction, score)


def _steps(line: Timeline, leg: Leg) -> NDArray[np.intp]:
    """The rows of a leg between which the task counted a step: of ticks that repeat it, the last."""
    rows = np.arange(leg.first, leg.last + 1)
    counts = np.diff(line.step[rows]) != 0
    return rows[np.append(counts, True)] if counts.any() else rows


def _detour(paths: list[Floats]) -> float:
    """Length of paths over the straight lines between their ends; 1 at the least."""
    length = sum(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in paths)
    straight = sum(float(np.linalg.norm(path[-1] - path[0])) for path in paths)
    if length <= 1e-9:
        return 1.0
    return max(1.0, length / max(straight, 1e-9))
