"""The links of a chain, read from a URDF: the joints that turn, and the fixed transforms between them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError

from rled_sim.joints import REVOLUTE, Joint, joints_to, rotation_about

Array = NDArray[np.float64]
Coordinate = Any
"""A float, or an array with one value for each state."""
Vector = Sequence[Coordinate]
"""Three coordinates."""

ROUNDING = 1e-11
"""Matrix entries this near to -1, 0 or 1 are meant to be it: URDFs write a quarter turn as 1.57079632679."""


class Fixed(NamedTuple):
    """A fixed transform: rotation, shape (3, 3), then translation (m), shape (3,)."""

    rotation: Array
    translation: Array

    def then(self, rotation: Array, translation: Array) -> "Fixed":
        """This transform followed by another, expressed in this one's frame."""
        return Fixed(self.rotation @ rotation, self.translation + self.rotation @ translation)


class Row(NamedTuple):
    """A row of a fixed transform, without the entries of the rotation that are 0.

    Attributes:
        terms: entries of the rotation, each with its column; one at least.
        offset: of the translation (m).
    """

    terms: tuple[tuple[float, int], ...]
    offset: float

    def direction(self, vector: Vector) -> Coordinate:
        """One coordinate of a direction, rotated."""
        products = [vector[axis] if factor == 1.0 else factor * vector[axis] for factor, axis in self.terms]
        total = products[0]
        for each in products[1:]:
            total = total + each
        return total

    def point(self, vector: Vector) -> Coordinate:
        """One coordinate of a point, rotated and translated (m)."""
        total = self.direction(vector)
        return total + self.offset if self.offset else total


class Link(NamedTuple):
    """A joint of a chain, and the fixed transform before it.

    Attributes:
        column: of the joint vector that it turns by.
        rows: of the fixed transform, three.
    """

    column: int
    rows: tuple[Row, ...]


def links_of(text: str, tip_link: str, names: tuple[str, ...]) -> tuple[list[Link], tuple[float, ...]]:
    """The links of the named joints, base first, and the tip in the frame of the last (m); other joints stay at 0.

    Raises:
        RledError: not a URDF, no such link, or a named joint that is not one revolute joint of the path.
    """
    path = joints_to(text, tip_link)
    turning = [joint.name for joint in path if joint.kind in REVOLUTE]
    missing = [name for name in names if name not in turning]
    if missing:
        raise RledError(f"no revolute joint {', '.join(missing)} moves '{tip_link}'", ", ".join(turning))
    order = [names.index(name) for name in turning if name in names]
    if len(order) > len(names):
        raise RledError(f"the URDF has joints of one name between the root and '{tip_link}'", "a name for each joint")
    *fixed, end = _fixed_transforms(path, names)
    links = [Link(column, _rows(each)) for column, each in zip(order, fixed, strict=True)]
    return links, tuple(end.translation.tolist())


def _rows(fixed: Fixed) -> tuple[Row, ...]:
    rows = zip(fixed.rotation.tolist(), fixed.translation.tolist(), strict=True)
    return tuple(
        Row(tuple((factor, axis) for axis, factor in enumerate(row) if factor), offset) for row, offset in rows
    )


def _fixed_transforms(path: Sequence[Joint], names: Sequence[str]) -> tuple[Fixed, ...]:
    """The fixed transforms before each of the named joints and after the last, each with its axis turned onto z."""
    folded, fixed = [], Fixed(np.eye(3), np.zeros(3))
    for joint in path:
        fixed = fixed.then(joint.rotation, joint.translation)
        if joint.name in names:
            turn = _onto_z(joint.axis)
            folded.append(fixed.then(turn, np.zeros(3)))
            fixed = Fixed(turn.T, np.zeros(3))
    return tuple(Fixed(_rounded(each.rotation), each.translation) for each in [*folded, fixed])


def _onto_z(axis: Array) -> Array:
    """A rotation whose z column is ``axis``."""
    if axis[2] == -1.0:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([-axis[1], axis[0], 0.0])
    sine = float(np.linalg.norm(cross))
    return np.eye(3) if sine == 0.0 else rotation_about(cross / sine, float(np.arctan2(sine, axis[2])))


def _rounded(rotation: Array) -> Array:
    nearest = np.rint(rotation)
    return np.where(np.abs(rotation - nearest) < ROUNDING, nearest, rotation)
