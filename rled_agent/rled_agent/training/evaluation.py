"""How well policies reach targets that were demonstrated, and others ever farther from them (figures 4.4, 4.7-4.9)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription
from rled_sim.kinematics import Chain, solve_position

from rled_agent.data.demonstrations import DemonstrationPoints

Floats = NDArray[np.float64]
Act = Callable[[Floats], Floats]


class DistanceBin(NamedTuple):
    """Targets at a distance from the demonstrated points.

    Attributes:
        name: for tables.
        starts: joint angles to start at (rad), shape (k, n).
        targets: points to reach (m), shape (k, 3).
    """

    name: str
    starts: Floats
    targets: Floats


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One motion towards one target.

    Attributes:
        reached: within the task's tolerance after a step, before the steps ran out.
        positions: end effector from start to end (m), shape (t, 3).
        joints: joint angles from start to end (rad), shape (t, n).
        target: the point to reach (m), shape (3,).
    """

    reached: bool
    positions: Floats
    joints: Floats
    target: Floats


class Trace(NamedTuple):
    """A motion step by step, as plain numbers.

    Attributes:
        distance: from the target (m), at the start and after each step.
        change: ‖Δq_t − Δq_{t−1}‖ (rad), from the second step on.
    """

    distance: list[float]
    change: list[float]


class Score(NamedTuple):
    """A policy in a distance bin.

    Attributes:
        success: share of targets reached.
        steps: mean steps to a reached target.
        path_length: mean length of the path to a reached target, over the straight line.
        jerk: root mean square of the end effector's jerk (m/s³).
        violations: mean risky states in a motion.
    """

    success: float
    steps: float
    path_length: float
    jerk: float
    violations: float


def seen_bin(points: DemonstrationPoints, size: int, generator: np.random.Generator) -> DistanceBin:
    """Targets among the demonstrated points."""
    starts, goals = generator.integers(len(points.joints), size=(2, size))
    return DistanceBin("seen", points.joints[starts], points.positions[goals])


def unseen_bin(
    task: TaskDescription,
    chain: Chain,
    points: DemonstrationPoints,
    distances: tuple[float, float],
    size: int,
    generator: np.random.Generator,
) -> DistanceBin:
    """Reachable targets whose distance (m) from the nearest demonstrated point lies between two bounds.

    Raises:
        RledError: too few such targets are reachable.
    """
    targets: list[Floats] = []
    for _ in range(200 * size):
        if len(targets) == size:
            break
        origin = generator.integers(len(points.positions))
        candidate = points.positions[origin] + _offset(task, distances[1], generator)
        nearest = np.linalg.norm(points.positions - candidate, axis=1)
        if distances[0] <= nearest.min() <= distances[1] and _reachable(
            task, chain, candidate, points.joints[nearest.argmin()]
        ):
            targets.append(candidate)
    name = f"{distances[0] * 100:g}-{distances[1] * 100:g} cm away"
    if len(targets) < size:
        raise RledError(f"only {len(targets)} reachable targets {name}", f"{size}", "choose bins nearer to the points")
    starts = points.joints[generator.integers(len(points.joints), size=size)]
    return DistanceBin(name, starts, np.array(targets))


def _offset(task: TaskDescription, distance: float, generator: np.random.Generator) -> Floats:
    offset = np.zeros(3)
    offset[list(task.axes)] = generator.uniform(-distance, distance, len(task.axes))
    return offset


def _reachable(task: TaskDescription, chain: Chain, target: Floats, near: Floats) -> bool:
    try:
        solve_position(chain, target, near, task.joint_lower, task.joint_upper, restarts=0)
    except RledError:
        return False
    return True


def move(task: TaskDescription, chain: Chain, act: Act, distance_bin: DistanceBin, steps: int) -> list[Trajectory]:
    """Drive to each target of a distance bin, all at once, by Eq. 4.28.

    Args:
        task: robot and task.
        chain: its kinematics.
        act: observations (k, o) to joint displacements (rad), (k, n).
        distance_bin: starts and targets.
        steps: most steps to a target.
    """
    q, ends = distance_bin.starts.copy(), np.full(len(distance_bin.starts), steps)
    joints, positions = [q], [chain.position(q)]
    for step in range(1, steps + 1):
        delta = np.clip(act(task.observe(q, positions[-1], distance_bin.targets)), -task.max_delta, task.max_delta)
        q = np.clip(q + delta, task.joint_lower, task.joint_upper)
        joints.append(q)
        positions.append(chain.position(q))
        arrived = np.square(positions[-1] - distance_bin.targets).sum(axis=1) < task.tolerance
        ends[arrived & (ends == steps)] = step
        if (ends < steps).all():
            break
    all_joints, all_positions = np.stack(joints, axis=1), np.stack(positions, axis=1)  # (k, t, n), (k, t, 3)
    reached = np.square(all_positions[:, 1:] - distance_bin.targets[:, None]).sum(axis=2).min(axis=1) < task.tolerance
    return [
        Trajectory(bool(reached[k]), all_positions[k, : end + 1], all_joints[k, : end + 1], distance_bin.targets[k])
        for k, end in enumerate(ends)
    ]


def trace(motion: Trajectory) -> Trace:
    """What of a motion shows how smooth it is, to a tenth of a millimetre and of a milliradian."""
    distance = np.linalg.norm(motion.positions - motion.target, axis=1)
    change = np.linalg.norm(np.diff(motion.joints, n=2, axis=0), axis=1)
    return Trace(distance.round(4).tolist(), change.round(4).tolist())


def score(
    task: TaskDescription,
    motions: Sequence[Trajectory],
    risky: Callable[[Sequence[float], tuple[float, float, float]], bool],
) -> Score:
    """Figures of a distance bin's motions."""
    reached = [motion for motion in motions if motion.reached and len(motion.positions) > 1]
    lengths = [
        _length(motion.positions) / np.linalg.norm(motion.positions[-1] - motion.positions[0]) for motion in reached
    ]
    violations = [
        sum(
            risky(q, (x[0], x[1], x[2])) for q, x in zip(motion.joints.tolist(), motion.positions.tolist(), strict=True)
        )
        for motion in motions
    ]
    jerks = [jerk(motion.positions, task.period * 1e-9) for motion in motions if len(motion.positions) > 3]
    return Score(
        success=float(np.mean([motion.reached for motion in motions])),
        steps=_mean([len(motion.positions) - 1 for motion in reached]),
        path_length=_mean(lengths),
        jerk=float(np.sqrt(_mean([value**2 for value in jerks]))),
        violations=_mean(violations),
    )


def jerk(positions: Floats, period: float) -> float:
    """Root mean square of the third derivative of a path (m/s³), by differences; t of at least 4."""
    third = np.diff(positions, n=3, axis=0) / period**3
    return float(np.sqrt(np.square(third).sum(axis=1).mean()))


def _length(positions: Floats) -> float:
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


def _mean(values: Sequence[float | np.floating[Any]]) -> float:
    return float(np.mean(np.asarray(values))) if len(values) else float("nan")
