"""Forward kinematics of a batch of joint vectors, its Jacobian and its inverse: numpy alone.

A chain of n revolute joints is F_1 Rz(q_1) F_2 Rz(q_2) ... F_n Rz(q_n) F_tip, with F fixed. The tip's position is
worked out from the tip to the base, as three coordinates, by a straight-line program in which the fixed transforms
are folded: what is multiplied by 0 or 1 costs nothing, and a joint whose axis the tip lies on is not even read.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rled_msgs_py.errors import RledError

from rled_sim.joints import TURNING, Joint, joints_to, rotation_about
from rled_sim.program import Program, Tape, Value

Array = NDArray[np.float64]

ROUNDING = 1e-11
"""Matrix entries this near to -1, 0 or 1 are meant to be it: URDFs write a quarter turn as 1.57079632679."""


class Fixed(NamedTuple):
    """A fixed transform: rotation, shape (3, 3), then translation (m), shape (3,)."""

    rotation: Array
    translation: Array

    def then(self, rotation: Array, translation: Array) -> "Fixed":
        """This transform followed by another, expressed in this one's frame."""
        return Fixed(self.rotation @ rotation, self.translation + self.rotation @ translation)


@dataclass(frozen=True)
class Chain:
    """A serial chain of n revolute joints, each turning about the z axis of its own frame.

    Attributes:
        joint_names: the n joints, in the order of the joint vectors.
        order: column of the joint vector that each link of the chain, base first, turns by.
        fixed: the n transforms before each joint, and the one from the last joint to the tip.
        program: the tip's position as a straight-line program on the n angles.
    """

    joint_names: tuple[str, ...]
    order: tuple[int, ...]
    fixed: tuple[Fixed, ...]
    program: Program

    @staticmethod
    def from_urdf(text: str, tip_link: str, joint_names: Sequence[str]) -> "Chain":
        """Compile the chain from the root of a URDF to ``tip_link``; joints not named stay at 0.

        Raises:
            RledError: not a URDF, no such link, or a named joint that is not one revolute joint on the way.
        """
        path = joints_to(text, tip_link)
        turning = [joint.name for joint in path if joint.kind in TURNING]
        missing = [name for name in joint_names if name not in turning]
        if missing:
            raise RledError(f"no revolute joint {', '.join(missing)} moves '{tip_link}'", ", ".join(turning))
        names = tuple(joint_names)
        order = tuple(names.index(name) for name in turning if name in names)
        if len(order) > len(names):
            raise RledError(f"the URDF has joints of one name on the way to '{tip_link}'", "a name for each joint")
        fixed = _fold(path, names)
        return Chain(names, order, fixed, _compile(fixed, order))

    def position(self, q: ArrayLike) -> Array:
        """Origin of the tip link in the root's frame (m) for joint angles (rad): (..., n) -> (..., 3)."""
        angles = self._angles(q)
        return self.program.run(angles.reshape(-1, angles.shape[-1])).reshape(*angles.shape[:-1], 3)

    def jacobian(self, q: ArrayLike) -> Array:
        """Derivative of ``position`` (m/rad): (..., n) -> (..., 3, n). Column i is z_i x (p - o_i)."""
        angles = self._angles(q)
        rotation = np.broadcast_to(self.fixed[0].rotation, (*angles.shape[:-1], 3, 3))
        origin = np.broadcast_to(self.fixed[0].translation, (*angles.shape[:-1], 3))
        axes, origins = [], []
        for column, fixed in zip(self.order, self.fixed[1:], strict=True):
            axes.append(rotation[..., 2])
            origins.append(origin)
            turned = rotation @ _turns(angles[..., column])
            rotation, origin = turned @ fixed.rotation, origin + turned @ fixed.translation
        jacobian = np.empty((*angles.shape[:-1], 3, len(self.order)))
        for column, axis, start in zip(self.order, axes, origins, strict=True):
            jacobian[..., column] = np.cross(axis, origin - start)
        return jacobian

    def _angles(self, q: ArrayLike) -> Array:
        angles = np.asarray(q, dtype=np.float64)
        if angles.ndim == 0 or angles.shape[-1] != len(self.joint_names):
            raise RledError(f"joint angles of shape {angles.shape}", f"(..., {len(self.joint_names)})")
        return angles


def solve_position(
    chain: Chain,
    target: ArrayLike,
    start: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    tolerance: float = 1e-4,
    iterations: int = 100,
    restarts: int = 20,
) -> Array:
    """Joint angles that bring the tip to a point, near ``start`` where it can be.

    Damped least squares, the damping proportional to the squared error (Sugihara 2011), clipped to the joint limits.
    Where it gets stuck it begins again from points spread evenly over the joint space.

    Args:
        chain: the robot.
        target: point to reach in the root's frame (m), shape (3,).
        start: joint angles to begin at (rad), shape (n,).
        lower: least joint angles (rad), shape (n,).
        upper: greatest joint angles (rad), shape (n,).
        tolerance: greatest distance from the target (m).
        iterations: steps from each beginning.
        restarts: beginnings after ``start``.

    Returns:
        Joint angles within the limits (rad), shape (n,).

    Raises:
        RledError: no joint angles found that bring the tip within ``tolerance``.
    """
    goal, low, high = (np.asarray(each, dtype=np.float64) for each in (target, lower, upper))
    best = np.inf
    for beginning in (np.asarray(start, dtype=np.float64), *_spread(low, high, restarts)):
        q, distance = _descend(chain, goal, np.clip(beginning, low, high), low, high, tolerance, iterations)
        if distance <= tolerance:
            return q
        best = min(best, distance)
    raise RledError(
        f"{goal.tolist()} m is out of reach: the nearest found is {best:.3g} m away",
        f"points that the tip reaches within {tolerance:g} m inside the joint limits",
    )


def _descend(
    chain: Chain, goal: Array, q: Array, lower: Array, upper: Array, tolerance: float, iterations: int
) -> tuple[Array, float]:
    """Step towards the goal; return the last joint angles and their distance (m)."""
    for _ in range(iterations):
        error = goal - chain.position(q)  # (3,)
        squared = float(error @ error)
        if squared <= tolerance**2:
            break
        jacobian = chain.jacobian(q)  # (3, n)
        damped = jacobian @ jacobian.T + (squared + 1e-9) * np.eye(3)
        q = np.clip(q + jacobian.T @ np.linalg.solve(damped, error), lower, upper)
    return q, float(np.linalg.norm(goal - chain.position(q)))


def _spread(lower: Array, upper: Array, count: int) -> Array:
    """Points spread evenly over a box by an additive recurrence, shape (count, n): the same on every call."""
    n = len(lower)
    root = 2.0
    for _ in range(50):  # x^(n+1) = x + 1, whose root generalises the golden ratio
        root = (1.0 + root) ** (1.0 / (n + 1))
    steps = root ** -np.arange(1.0, n + 1)  # (n,)
    return lower + (np.arange(1, count + 1)[:, None] * steps % 1.0) * (upper - lower)


def _turns(angle: Array) -> Array:
    """Rotations about z: (...,) -> (..., 3, 3)."""
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, np.ones_like(angle)]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _fold(path: Sequence[Joint], names: Sequence[str]) -> tuple[Fixed, ...]:
    """The fixed transforms between the named joints, each with its axis turned onto z."""
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


def _compile(fixed: Sequence[Fixed], order: Sequence[int]) -> Program:
    tape = Tape()
    point: tuple[Value, ...] = tuple(map(float, fixed[-1].translation))
    for column, transform in zip(reversed(order), reversed(fixed[:-1]), strict=True):
        x, y, z = point
        if not (x == 0.0 and y == 0.0):
            s, c = tape.turn(column)
            x, y = (
                tape.sum((1.0, tape.product(c, x)), (-1.0, tape.product(s, y))),
                tape.sum((1.0, tape.product(s, x)), (1.0, tape.product(c, y))),
            )
        rows = zip(transform.rotation.tolist(), transform.translation.tolist(), strict=True)
        point = tuple(tape.sum((offset, 1.0), *zip(row, (x, y, z), strict=True)) for row, offset in rows)
    return tape.program(point)
