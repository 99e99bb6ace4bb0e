"""What the simulation needs of a robot that can be moved: PyBullet's world is one, a recorded or a real arm may be."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rled_sim.robots import Robot

Point = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""


class Contact(NamedTuple):
    """A link of the robot that touches something: the floor, or another link."""

    link: str
    other: str


class Plant(Protocol):
    """A robot, moved by joint displacements, one period each; its state is what the last one led to."""

    @property
    def robot(self) -> Robot:
        """The robot."""
        ...

    @property
    def q(self) -> list[float]:
        """Joint angles (rad), n."""
        ...

    @property
    def velocity(self) -> list[float]:
        """Joint rates (rad/s), n."""
        ...

    @property
    def position(self) -> Point:
        """Origin of the tip link in the frame ``world`` (m)."""
        ...

    @property
    def orientation(self) -> Quaternion:
        """Of the tip link in the frame ``world``."""
        ...

    @property
    def set_point(self) -> list[float]:
        """Joint angles that a displacement is added to (rad), n: the motors' set point, or ``q``."""
        ...

    @property
    def physical(self) -> bool:
        """The robot is moved by forces, and can touch something."""
        ...

    def place(self, q: Sequence[float]) -> None:
        """Put the robot at rest at joint angles (rad), n of them."""

    def move(self, delta: Sequence[float]) -> None:
        """Displace the joints by Δq (rad), n finite numbers, within the joint limits; one period passes."""

    def halt(self) -> None:
        """Ask for no further motion."""

    def contacts(self) -> list[Contact]:
        """What the robot touches in this state."""
        ...

    def touches(self, q: NDArray[np.float64]) -> Mapping[Contact, float]:
        """What the robot would touch at joint angles (rad), shape (n,), and how deep (m); nothing moves."""
        ...

    def close(self) -> None:
        """Let go of the robot; a second call does nothing."""
