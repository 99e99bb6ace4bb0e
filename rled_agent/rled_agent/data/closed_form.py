"""ζᵇ in closed form: every ordered pair of marked points, joined by the demonstrated action."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.bags import Bag
from rled_msgs_py.bags.episodes import discarded
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.topics import MARKED_EE_POSE, MARKED_JOINT_STATES
from rled_sim.kinematics import Chain

from rled_agent.data.corruption import NO_CORRUPTION, Corruption
from rled_agent.data.demonstrations import DemonstrationError, DemonstrationPoints, Floats, Moves, StateActions
from rled_agent.data.spans import lie_in


class Shown(NamedTuple):
    """Transitions of ζᵇ, from where on and how.

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

    def replaced(self, which: NDArray[np.bool_], others: "Shown") -> "Shown":
        """The same with the chosen transitions taken from ``others``, in order."""
        columns = [column.copy() for column in self]
        for column, other in zip(columns, others, strict=True):
            column[which] = other
        return Shown(*columns)


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
        corruption: how poor they are made.
    """

    task: TaskDescription
    points: DemonstrationPoints
    chain: Chain
    pairs: NDArray[np.bool_] | None = None
    corruption: Corruption = NO_CORRUPTION

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
        return self.corruption.goals_shown(len(self.points.joints))

    @cached_property
    def _is_one_target(self) -> bool:
        points = self.points.positions
        return bool((_squared(points - points[0]) < self.task.tolerance).all())

    @property
    def visited(self) -> DemonstrationPoints:
        """ζᵃ."""
        return self.points

    @property
    def starts(self) -> Floats:
        """Joint angles of ζᵃ (rad), shape (k, n)."""
        return self.points.joints

    def __len__(self) -> int:
        """Number of transitions in ζᵇ."""
        return int(self._ends[-1])

    def sample(self, size: int, generator: np.random.Generator) -> StateActions:
        """Draw ``size`` transitions of ζᵇ uniformly."""
        drawn = self.draw(size, generator)
        return StateActions(self.task.observe(drawn.q, drawn.position, drawn.target), drawn.action)

    def draw(self, size: int, generator: np.random.Generator) -> "Shown":
        """Draw ``size`` transitions of ζᵇ uniformly, as they are shown."""
        intended = self.at(generator.integers(len(self), size=size))
        return intended._replace(action=self.corruption.shaken(intended.action, self.task.max_delta, generator))

    def moves(self, size: int, generator: np.random.Generator) -> Moves:
        """Draw ``size`` transitions of ζᵇ that begin away from their target.

        The next state of a reached target has a new target, drawn as the task draws it.

        Raises:
            DemonstrationError: points so near to each other that no transition leads to a target not yet reached.
        """
        points, tolerance = self.points.positions, self.task.tolerance
        if self._is_one_target:
            what = "all marked points lie within the tolerance of one target"
            raise DemonstrationError(what, f"points {tolerance**0.5:.3g} m apart or more", "mark more of the curve")
        drawn = self.draw(size, generator)
        while (arrived := _squared(drawn.position - drawn.target) < tolerance).any():
            drawn = drawn.replaced(arrived, self.draw(int(arrived.sum()), generator))
        q = drawn.q + drawn.action
        position = self.chain.position(q)
        reached = _squared(position - drawn.target) < tolerance
        target = np.where(reached[:, None], points[generator.integers(len(points), size=size)], drawn.target)
        return Moves(*drawn, q, position, target, np.full(size, np.nan))

    def at(self, transition: NDArray[np.int64]) -> "Shown":
        """The transitions of the given running numbers, shape (k,), of a hand that does not tremble."""
        pair = np.searchsorted(self._ends, transition, side="right")
        before = np.where(pair > 0, self._ends[pair - 1], 0)
        start, goal = np.divmod(pair, len(self.points.joints))
        q_0, q_goal = self.points.joints[start], self.points.joints[goal]  # (k, n)
        segment = q_goal - q_0  # (k, n)
        length = np.abs(segment).max(axis=1, keepdims=True)  # (k, 1), e_qmax at the start
        done = (transition - before)[:, None] * self.task.max_delta  # (k, 1)
        q = q_0 + segment * (done / length)
        action = segment / length * np.minimum(length - done, self.task.max_delta)
        shown = self._goals[pair] if self.corruption.wrong else goal
        return Shown(q, self.chain.position(q), self.points.positions[shown], action)

    def split(self, share: float, generator: np.random.Generator) -> tuple["JoinedPoints", "JoinedPoints"]:
        """Set a share of the pairs aside."""
        k = len(self.points.joints)
        aside = generator.random((k, k)) < share
        both = np.ones((k, k), dtype=bool) if self.pairs is None else self.pairs
        return replace(self, pairs=both & ~aside), replace(self, pairs=both & aside)


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
    kept = ~lie_in(stamps, [(first, last + 1) for first, last in discarded(bag)])
    of_joints, of_poses = of_joints[kept], of_poses[kept]
    if 0 < count < len(of_joints):
        spaced = np.linspace(0, len(of_joints) - 1, count).round().astype(np.int64)
        of_joints, of_poses = of_joints[spaced], of_poses[spaced]
    if len(of_joints) < 2:
        raise DemonstrationError(
            f"the bag holds {len(of_joints)} marked points",
            "2 or more",
            "record with marks, or take the motions: --source trajectories",
        )
    return DemonstrationPoints(poses.position[of_poses], joints.position[of_joints])


def joined_points(bag: Bag, count: int = 0, corruption: Corruption = NO_CORRUPTION) -> JoinedPoints:
    """ζᵇ in closed form from a bag's ζᵃ, or ``count`` points of it, and its robot description."""
    chain = Chain.from_urdf(bag.robot_description, bag.task.tip_link, bag.task.joint_names)
    return JoinedPoints(bag.task, demonstration_points(bag, count), chain, corruption=corruption)


def _squared(vectors: Floats) -> Floats:
    squared: Floats = np.square(vectors).sum(axis=1)
    return squared
