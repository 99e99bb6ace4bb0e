"""Demonstrations as they were recorded, by whomever: a script, keys, a page, in lockstep or in real time."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.bags import Bag
from rled_msgs_py.bags.faults import JUMP_FACTOR
from rled_msgs_py.bags.series import series
from rled_msgs_py.bags.timeline import Timeline, read_timeline
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.topics import MARKED_JOINT_STATES

from rled_agent.data.demonstrations import DemonstrationError, DemonstrationPoints, Floats, Moves, StateActions
from rled_agent.data.episode_filter import Episodes
from rled_agent.data.spans import lie_in, outside

STILL = 1e-9
"""Share of Δq_max below which nothing has moved."""


class Answers(NamedTuple):
    """States and the displacements that answered them.

    Attributes:
        observations: x, shape (k, o).
        actions: Δq (rad), shape (k, n).
        trajectory: number of the trajectory that each belongs to, shape (k,).
    """

    observations: Floats
    actions: Floats
    trajectory: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class RecordedTrajectories:
    """Transitions as they travelled on the topics.

    Attributes:
        task: robot and task.
        answers: displacements that operators answered to what they saw.
        carried_out: what moved, and where it led to; ticks in which the robot held are left out.
        moved: number of the trajectory that each row of ``carried_out`` belongs to, shape (m,).
    """

    task: TaskDescription
    answers: Answers
    carried_out: Moves
    moved: NDArray[np.int64]

    @property
    def visited(self) -> DemonstrationPoints:
        """Poses that the motions go through."""
        moves = self._moves()
        positions, joints = (moves.position, moves.next_position), (moves.q, moves.next_q)
        return DemonstrationPoints(np.concatenate(positions), np.concatenate(joints))

    @property
    def starts(self) -> Floats:
        """Joint angles that motions begin at (rad), shape (k, n)."""
        _, first = np.unique(self.moved, return_index=True)
        return self._moves().q[first]

    def __len__(self) -> int:
        """Number of answered states."""
        return len(self.answers.actions)

    def sample(self, size: int, generator: np.random.Generator) -> StateActions:
        """Draw ``size`` answered states uniformly."""
        drawn = generator.integers(len(self), size=size)
        return StateActions(self.answers.observations[drawn], self.answers.actions[drawn])

    def moves(self, size: int, generator: np.random.Generator) -> Moves:
        """Draw ``size`` transitions uniformly.

        Raises:
            DemonstrationError: there are none whose next state is known.
        """
        moves = self._moves()
        drawn = generator.integers(len(moves.q), size=size)
        return moves.at(drawn)

    def split(
        self, share: float, generator: np.random.Generator
    ) -> tuple["RecordedTrajectories", "RecordedTrajectories"]:
        """Set a share of the trajectories aside, one at least."""
        numbers = np.unique(self.answers.trajectory)
        aside = generator.permutation(numbers)[: max(1, round(share * len(numbers)))]
        return self._part(np.setdiff1d(numbers, aside)), self._part(aside)

    def _part(self, numbers: NDArray[np.int64]) -> "RecordedTrajectories":
        answered, moved = np.isin(self.answers.trajectory, numbers), np.isin(self.moved, numbers)
        shown, trajectory = self.answers, self.answers.trajectory[answered]
        answers = Answers(shown.observations[answered], shown.actions[answered], trajectory)
        return replace(self, answers=answers, carried_out=self.carried_out.at(moved), moved=self.moved[moved])

    def _moves(self) -> Moves:
        if not len(self.carried_out.q):
            what = "no recorded motion has a state that it led to"
            raise DemonstrationError(what, "one or more", "record whole motions, with all four state topics")
        return self.carried_out


def recorded_trajectories(bag: Bag, chosen: Episodes | None = None) -> RecordedTrajectories:
    """The transitions that a bag recorded after its last mark; before it the operator did not go for targets.

    Pauses are left out, answers of no displacement too: a hand at rest does not show where to go.

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
    left_out = _left_out(bag, chosen)
    trajectory = _trajectories(line, left_out)
    is_chosen = ~lie_in(line.moments, left_out)
    has_moved = (np.abs(np.nan_to_num(line.action)) > STILL * task.max_delta).any(axis=1)
    rows = np.flatnonzero(line.answered & has_moved & is_chosen)
    if not len(rows):
        raise DemonstrationError("the bag holds no recorded trajectory", "states answered by a displacement")
    observations = task.observe(line.q[rows], line.position[rows], line.target[rows])
    moves, before = _carried_out(task, line, is_chosen)
    return RecordedTrajectories(
        task, Answers(observations, line.action[rows], trajectory[rows]), moves, trajectory[before]
    )


def _left_out(bag: Bag, chosen: Episodes | None) -> list[tuple[int, int]]:
    left_out = [] if chosen is None else chosen.left_out
    marks = series(bag, MARKED_JOINT_STATES).moments
    if chosen is not None and chosen.spans is not None:
        return sorted(outside(chosen.spans) + left_out)
    return sorted([(-1, int(marks[-1]) + 1), *left_out]) if len(marks) else left_out


def _carried_out(task: TaskDescription, line: Timeline, is_chosen: NDArray[np.bool_]) -> tuple[Moves, NDArray[np.intp]]:
    """The displacements that were carried out, and the ticks before them.

    The task counts a step where the robot moved and none where it held, so ticks with one count are one state, and the
    next count is what it led to. The action is the way between the two: an answer that came a tick late was an answer
    to another state than the one that it moved.
    """
    counts = np.stack([line.episode, line.step])
    before = np.flatnonzero((np.diff(counts, axis=1) == [[0], [1]]).all(axis=0))
    delta = line.q[before + 1] - line.q[before]
    kept = is_chosen[before] & (np.abs(delta) > STILL * task.max_delta).any(axis=1)
    before, action = before[kept], np.clip(delta[kept], -task.max_delta, task.max_delta)
    after = before + 1
    final = (line.reached[after] == task.targets_per_episode).astype(np.float64)
    states = line.q[before], line.position[before], line.target[before], action
    following = line.q[after], line.position[after], line.target[after]
    return Moves(*states, *following, final), before


def _trajectories(line: Timeline, left_out: list[tuple[int, int]]) -> NDArray[np.int64]:
    """The trajectory that each tick belongs to; one ends where something is left out."""
    gaps = np.searchsorted(np.array([first for first, _ in left_out], np.int64), line.moments, side="right")
    places = np.stack([np.cumsum(_begins(line)), gaps])
    numbers: NDArray[np.int64] = np.cumsum((np.diff(places, prepend=places[:, :1]) != 0).any(axis=0))
    return numbers


def _begins(line: Timeline) -> NDArray[np.bool_]:
    """Whether a trajectory begins with each tick: another target or episode, or ticks are missing before it."""
    steps = np.diff(line.moments, prepend=line.moments[:1])
    usual = np.median(steps[1:]) if len(steps) > 1 else 0.0
    begins: NDArray[np.bool_] = np.any(np.diff(line.target, axis=0, prepend=line.target[:1]) != 0, axis=1)
    begins |= (np.diff(line.episode, prepend=line.episode[:1]) != 0) | (steps > JUMP_FACTOR * usual)
    return begins
