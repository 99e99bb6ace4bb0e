"""Demonstrations as arrays: the points ζᵃ, the trajectories ζᵇ in closed form, and recorded trajectories."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.bags import Bag
from rled_msgs_py.bags.episodes import discarded
from rled_msgs_py.bags.faults import JUMP_FACTOR
from rled_msgs_py.bags.series import series
from rled_msgs_py.bags.timeline import Timeline, read_timeline
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.topics import MARKED_EE_POSE, MARKED_JOINT_STATES
from rled_sim.kinematics import Chain

from rled_agent.flaws import NO_FLAWS, Flaws
from rled_agent.selection import Episodes, outside, select_episodes, select_points

Floats = NDArray[np.float64]


class DemonstrationError(RledError):
    """A bag that holds no usable demonstration."""


class StateActions(NamedTuple):
    """Demonstrated pairs (xᵈ, Δqᵈ).

    Attributes:
        observations: x, shape (k, o).
        actions: Δq (rad), shape (k, n).
    """

    observations: Floats
    actions: Floats


class Moves(NamedTuple):
    """Demonstrated transitions in joint and task space.

    Attributes:
        q: joint angles before (rad), shape (k, n).
        position: end effector before (m), shape (k, 3).
        target: target (m), shape (k, 3).
        action: Δq (rad), shape (k, n).
    """

    q: Floats
    position: Floats
    target: Floats
    action: Floats

    def replaced(self, which: NDArray[np.bool_], others: "Moves") -> "Moves":
        """The same with the chosen transitions taken from ``others``, in order."""
        columns = [column.copy() for column in self]
        for column, other in zip(columns, others, strict=True):
            column[which] = other
        return Moves(*columns)


class Demonstrations(Protocol):
    """Where expert pairs are drawn from."""

    @property
    def task(self) -> TaskDescription:
        """Robot and task."""
        ...

    def __len__(self) -> int:
        """Number of demonstrated transitions."""
        ...

    def sample(self, size: int, generator: np.random.Generator) -> StateActions:
        """Draw ``size`` pairs uniformly, with replacement."""
        ...

    def split(self, share: float, generator: np.random.Generator) -> tuple[Self, Self]:
        """Set a share of the trajectories aside: (the rest, the share)."""
        ...


@dataclass(frozen=True, eq=False)
class DemonstrationPoints:
    """ζᵃ: poses that the operator marked (section 4.1.3).

    Attributes:
        positions: end effector X_i (m), shape (k, 3).
        joints: joint angles q_i (rad), shape (k, n).
    """

    positions: Floats
    joints: Floats


@dataclass(frozen=True, eq=False)
class JoinedPoints:
    """ζᵇ in closed form: every ordered pair of points of ζᵃ, joined by the demonstrated action.

    The motion from q_i to q_j is a straight line in joint space, at most Δq_max per step in the joint that
    has farthest to go. Its k-th step is known without the steps before it, so ζᵇ is never stored: drawing
    uniformly from its transitions means drawing a pair with weight T_ij = ⌈max_k |q_j,k − q_i,k| / Δq_max⌉ and a
    step uniformly.

    Attributes:
        task: robot and task.
        points: ζᵃ.
        chain: forward kinematics f.
        pairs: which ordered pairs belong, shape (k, k); all of them when not given.
        flaws: how poorly they were demonstrated.
    """

    task: TaskDescription
    points: DemonstrationPoints
    chain: Chain
    pairs: NDArray[np.bool_] | None = None
    flaws: Flaws = NO_FLAWS

    @cached_property
    def _ends(self) -> NDArray[np.int64]:
        """Running number of transitions after each pair (i, j), in row order, shape (k * k,)."""
        q = self.points.joints
        farthest = np.zeros((len(q), len(q)))
        for joint in q.T:
            np.maximum(farthest, np.abs(joint[:, None] - joint), out=farthest)
        steps = np.ceil(farthest / self.task.max_delta - 1e-9).astype(np.int64)
        if self.pairs is not None:
            steps *= self.pairs
        return np.cumsum(steps.ravel())

    @cached_property
    def _goals(self) -> NDArray[np.int64]:
        return self.flaws.goals_shown(len(self.points.joints))

    def __len__(self) -> int:
        """Number of transitions in ζᵇ."""
        return int(self._ends[-1])

    def sample(self, size: int, generator: np.random.Generator) -> StateActions:
        """Draw ``size`` transitions of ζᵇ uniformly."""
        drawn = self.draw(size, generator)
        return StateActions(self.task.observe(drawn.q, drawn.position, drawn.target), drawn.action)

    def draw(self, size: int, generator: np.random.Generator) -> "Moves":
        """Draw ``size`` transitions of ζᵇ uniformly, before they are made observations of."""
        intended = self.at(generator.integers(len(self), size=size))
        return intended._replace(action=self.flaws.shaken(intended.action, self.task.max_delta, generator))

    def at(self, transition: NDArray[np.int64]) -> "Moves":
        """The transitions of the given running numbers, shape (k,), of a hand that does not tremble."""
        pair = np.searchsorted(self._ends, transition, side="right")
        before = np.where(pair > 0, self._ends[pair - 1], 0)
        start, goal = np.divmod(pair, len(self.points.joints))
        q_0, q_goal = self.points.joints[start], self.points.joints[goal]  # (k, n)
        way = q_goal - q_0  # (k, n)
        length = np.abs(way).max(axis=1, keepdims=True)  # (k, 1), e_qmax at the start
        done = (transition - before)[:, None] * self.task.max_delta  # (k, 1)
        q = q_0 + way * (done / length)
        action = way / length * np.minimum(length - done, self.task.max_delta)
        shown = self._goals[pair] if self.flaws.wrong else goal
        return Moves(q, self.chain.position(q), self.points.positions[shown], action)

    def split(self, share: float, generator: np.random.Generator) -> tuple["JoinedPoints", "JoinedPoints"]:
        """Set a share of the pairs aside."""
        k = len(self.points.joints)
        aside = generator.random((k, k)) < share
        both = np.ones((k, k), dtype=bool) if self.pairs is None else self.pairs
        return replace(self, pairs=both & ~aside), replace(self, pairs=both & aside)


@dataclass(frozen=True, eq=False)
class RecordedTrajectories:
    """Transitions as they travelled on the topics.

    Attributes:
        task: robot and task.
        observations: x, shape (k, o).
        actions: Δq (rad), shape (k, n).
        trajectory: number of the trajectory that each transition belongs to, shape (k,).
    """

    task: TaskDescription
    observations: Floats
    actions: Floats
    trajectory: NDArray[np.int64]

    def __len__(self) -> int:
        """Number of transitions."""
        return len(self.actions)

    def sample(self, size: int, generator: np.random.Generator) -> StateActions:
        """Draw ``size`` transitions uniformly."""
        drawn = generator.integers(len(self), size=size)
        return StateActions(self.observations[drawn], self.actions[drawn])

    def split(
        self, share: float, generator: np.random.Generator
    ) -> tuple["RecordedTrajectories", "RecordedTrajectories"]:
        """Set a share of the trajectories aside, one at least."""
        numbers = np.unique(self.trajectory)
        aside = np.isin(self.trajectory, generator.permutation(numbers)[: max(1, round(share * len(numbers)))])
        return self._part(~aside), self._part(aside)

    def _part(self, chosen: NDArray[np.bool_]) -> "RecordedTrajectories":
        return RecordedTrajectories(self.task, self.observations[chosen], self.actions[chosen], self.trajectory[chosen])


def demonstration_points(bag: Bag, count: int = 0) -> DemonstrationPoints:
    """Read ζᵃ from a bag's marks, those in discarded episodes less.

    Args:
        bag: a recording.
        count: take only so many of them, evenly spaced in the order of the marks; 0 takes all.

    Raises:
        DemonstrationError: fewer than two points.
        ContractError: marks that lack a joint of the task.
    """
    joints, poses = bag.joints(MARKED_JOINT_STATES), bag.poses(MARKED_EE_POSE)
    joints = joints.ordered(bag.task.joint_names) if len(joints.stamps) else joints
    stamps, of_joints, of_poses = np.intersect1d(joints.stamps, poses.stamps, return_indices=True)
    kept = ~_lie_in(stamps, [(first, last + 1) for first, last in discarded(bag)])
    of_joints, of_poses = of_joints[kept], of_poses[kept]
    if 0 < count < len(of_joints):
        spaced = np.linspace(0, len(of_joints) - 1, count).round().astype(np.int64)
        of_joints, of_poses = of_joints[spaced], of_poses[spaced]
    if len(of_joints) < 2:
        raise DemonstrationError(f"the bag holds {len(of_joints)} marked points", "2 or more", "record with marks")
    return DemonstrationPoints(poses.position[of_poses], joints.position[of_joints])


def joined_points(bag: Bag, count: int = 0, flaws: Flaws = NO_FLAWS) -> JoinedPoints:
    """ζᵇ in closed form from a bag's ζᵃ, or ``count`` points of it, and its robot description."""
    chain = Chain.from_urdf(bag.robot_description, bag.task.tip_link, bag.task.joint_names)
    return JoinedPoints(bag.task, demonstration_points(bag, count), chain, flaws=flaws)


def recorded_trajectories(bag: Bag, chosen: Episodes | None = None) -> RecordedTrajectories:
    """The transitions that a bag recorded after its last mark; before it the operator did not go for targets.

    Args:
        bag: a recording.
        chosen: the episodes to take, all of them by default.

    Raises:
        DemonstrationError: no answered state in it, or stamps that begin anew.
        ContractError: a joint of the task is in no message.
    """
    task, line = bag.task, read_timeline(bag)
    if line.is_anew.any():
        raise DemonstrationError("the simulation was restarted while the bag was recorded", "one run", "record again")
    left_out = [] if chosen is None else chosen.left_out
    marks = series(bag, MARKED_JOINT_STATES).moments
    if chosen is not None and chosen.spans is not None:
        left_out = sorted(outside(chosen.spans) + left_out)
    elif len(marks):
        left_out = sorted([(-1, int(marks[-1]) + 1), *left_out])
    rows = np.flatnonzero(line.answered & ~_lie_in(line.moments, left_out))
    if not len(rows):
        raise DemonstrationError("the bag holds no recorded trajectory", "states answered by joint_delta")
    gaps = np.searchsorted(np.array([first for first, _ in left_out], np.int64), line.moments[rows], side="right")
    places = np.stack([np.cumsum(_begins(line))[rows], gaps])
    trajectory = np.cumsum((np.diff(places, prepend=places[:, :1]) != 0).any(axis=0))
    observations = task.observe(line.q[rows], line.position[rows], line.target[rows])
    return RecordedTrajectories(task, observations, line.action[rows], trajectory)


def _begins(line: Timeline) -> NDArray[np.bool_]:
    """Whether a trajectory begins with each tick: another target or episode, or ticks are missing before it."""
    steps = np.diff(line.moments, prepend=line.moments[:1])
    usual = np.median(steps[1:]) if len(steps) > 1 else 0.0
    begins: NDArray[np.bool_] = np.any(np.diff(line.target, axis=0, prepend=line.target[:1]) != 0, axis=1)
    begins |= (np.diff(line.episode, prepend=line.episode[:1]) != 0) | (steps > JUMP_FACTOR * usual)
    return begins


def open_demonstrations(
    path: Path,
    source: str,
    min_quality: float = 0.0,
    say: Callable[[str], None] = lambda _: None,
    points: int = 0,
    flaws: Flaws = NO_FLAWS,
) -> Demonstrations:
    """Open a bag's demonstrations.

    Args:
        path: the bag.
        source: ``points`` (ζᵇ in closed form) or ``trajectories`` (as recorded).
        min_quality: least quality of an episode, for ``trajectories`` only.
        say: takes a line for each part that is left out.
        points: take only so many marked points, 0 for all; for ``points`` only.
        flaws: how poor they are made; for ``points`` only.

    Raises:
        RledError: the bag is damaged or faulty, or holds nothing of the kind.
    """
    bag = Bag(path)
    if source == "points":
        if min_quality > 0.0:
            raise DemonstrationError(f"--min-quality {min_quality:g} with --source points", "--source trajectories")
        select_points(bag, say)
        return joined_points(bag, points, flaws)
    if flaws != NO_FLAWS:
        raise DemonstrationError("--flaws with --source trajectories", "--source points")
    if points:
        raise DemonstrationError(f"--points {points} with --source trajectories", "--source points")
    return recorded_trajectories(bag, select_episodes(bag, min_quality, say))


def _lie_in(stamps: NDArray[np.int64], spans: list[tuple[int, int]]) -> NDArray[np.bool_]:
    """Whether each stamp lies in one of spans, each its first moment and its end, shape (k,)."""
    inside = np.zeros(len(stamps), dtype=bool)
    for first, stop in spans:
        inside |= (stamps >= first) & (stamps < stop)
    return inside
