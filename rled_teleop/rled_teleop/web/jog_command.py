"""What the person at the page wants the robot to do."""

from typing import NamedTuple


class Follow(NamedTuple):
    """Take the tool to a point.

    Attributes:
        goal: (m), shape (3,).
    """

    goal: tuple[float, float, float]


class Move(NamedTuple):
    """Move the tool along a direction.

    Attributes:
        direction: of length 1, in the base frame, shape (3,).
    """

    direction: tuple[float, float, float]


class Turn(NamedTuple):
    """Take one joint to an angle.

    Attributes:
        joint: which.
        goal: (rad).
    """

    joint: int
    goal: float


JogCommand = Follow | Move | Turn
