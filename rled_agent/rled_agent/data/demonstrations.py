"""Demonstrations as arrays: what cloning and reinforcement learning draw from."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription

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
        next_q: joint angles after (rad), shape (k, n).
        next_position: end effector after (m), shape (k, 3).
        next_target: target after (m), another one where it was reached, shape (k, 3).
        final: 1 where the episode was seen to end there, its last target reached, 0 where it was seen to go on, NaN
            where nobody saw it, shape (k,).
    """

    q: Floats
    position: Floats
    target: Floats
    action: Floats
    next_q: Floats
    next_position: Floats
    next_target: Floats
    final: Floats

    def at(self, rows: NDArray[Any]) -> "Moves":
        """Some of them, by their numbers or by a mask."""
        return Moves(*(column[rows] for column in self))


@dataclass(frozen=True, eq=False)
class DemonstrationPoints:
    """ζᵃ: poses that the operator marked (section 4.1.3).

    Attributes:
        positions: end effector X_i (m), shape (k, 3).
        joints: joint angles q_i (rad), shape (k, n).
    """

    positions: Floats
    joints: Floats


class Demonstrations(Protocol):
    """What somebody showed."""

    @property
    def task(self) -> TaskDescription:
        """Robot and task."""
        ...

    @property
    def visited(self) -> DemonstrationPoints:
        """Poses that the demonstrations go through; a learner's scaling comes of them."""
        ...

    @property
    def starts(self) -> Floats:
        """Joint angles that motions begin at (rad), shape (k, n)."""
        ...

    def __len__(self) -> int:
        """Number of demonstrated transitions."""
        ...

    def sample(self, size: int, generator: np.random.Generator) -> StateActions:
        """Draw ``size`` pairs uniformly, with replacement, for cloning."""
        ...

    def moves(self, size: int, generator: np.random.Generator) -> Moves:
        """Draw ``size`` transitions uniformly, with replacement, for reinforcement learning.

        Raises:
            DemonstrationError: there are none whose next state is known.
        """
        ...

    def split(self, share: float, generator: np.random.Generator) -> tuple[Self, Self]:
        """Set a share of the trajectories aside: (the rest, the share)."""
        ...
