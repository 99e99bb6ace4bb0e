"""Which displacements a robot may carry out: the last guard before the motors. Numpy alone, so any driver can call it.

A limit never traps: to stay is always within the limits, and so is what leads out of a forbidden place. Speeding up is
limited, braking is not, since the answer to a refusal is to stand still, the hardest braking there is.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.task_limits import Zone
from rled_msgs_py.vectors import is_finite

from rled_sim.commands import ROUNDING, Code, Refused, too_large
from rled_sim.kinematics import Chain
from rled_sim.plant import Contact

Array = NDArray[np.float64]
Check = tuple[Callable[..., "Refused | None"], tuple[Any, ...]]
"""How a proposal is judged, and what by; called with guard, what by, and proposal."""
Touches = Callable[[Array], Mapping[Contact, float]]
"""From joint angles (rad) to what would touch, a link of the robot and the other body, and how deep (m)."""

FLOOR = "floor"
WAYPOINTS = 9
"""Points along a displacement at which the end effector is looked at, both ends included: zones may be thin."""
SLACK = 1e-9
"""Rounding of angles (rad) and lengths (m)."""


class Proposal(NamedTuple):
    """A displacement proposed in a state.

    Attributes:
        q: joint angles (rad), shape (n,).
        previous: displacement carried out in the period before (rad), shape (n,).
        delta: displacement proposed (rad), shape (n,).
    """

    q: Array
    previous: Array
    delta: Array


class Guard:
    """Judges displacements by a task's Δq_max and limits; it remembers nothing.

    Args:
        task: Δq_max, period and limits.
        chain: the robot's kinematics; only needed for limits of the end effector.
        touches: tells what would touch; without it collisions are left to whoever can tell.

    Raises:
        RledError: limits of the end effector without a chain.
    """

    def __init__(self, task: TaskDescription, chain: Chain | None = None, touches: Touches | None = None) -> None:
        limits = task.limits
        self._task, self._limits, self._period = task, limits, task.period * 1e-9
        if chain is None and (limits.tip_lower or limits.keep_out):
            raise RledError("limits of the end effector", "a kinematic chain", "give the guard one")
        self._checks = list(self._checks_of(chain, touches))

    def _checks_of(self, chain: Chain | None, touches: Touches | None) -> Iterator[Check]:
        """Unbound, so that nothing refers to itself: a world that is dropped is then closed at once."""
        limits = self._limits
        if limits.joint_lower:
            yield Guard._judge_range, (np.array(limits.joint_lower), np.array(limits.joint_upper))
        if limits.velocity:
            yield Guard._judge_velocity, (np.array(limits.velocity),)
        if limits.acceleration:
            yield Guard._judge_acceleration, (np.array(limits.acceleration),)
        if chain is not None and (limits.tip_lower or limits.keep_out):
            yield Guard._judge_tip, (chain,)
        if touches is not None and limits.collisions:
            yield Guard._judge_collisions, (touches,)

    def judge(self, q: ArrayLike, previous: ArrayLike, delta: ArrayLike) -> Refused | None:
        """Why a displacement must not be carried out; None when it may.

        Args:
            q: joint angles that it starts from (rad), shape (n,): measured, or the motors' set point.
            previous: displacement of the period before (rad), shape (n,); zeros after standing still.
            delta: displacement proposed (rad), shape (n,); NaN and infinity are refused.

        Raises:
            RledError: vectors of another shape.
        """
        proposal = Proposal(*(np.asarray(each, dtype=np.float64) for each in (q, previous, delta)))
        for name, vector in zip(Proposal._fields, proposal, strict=True):
            if vector.shape != (self._task.action_size,):
                raise RledError(f"{name} of shape {vector.shape}", f"({self._task.action_size},)")
            if not is_finite(vector):
                return Refused(Code.UNREADABLE, f"{name} holds {vector.tolist()}", "finite numbers (rad)")
        refused = too_large(proposal.delta, self._task.max_delta)
        if refused is not None or not any(proposal.delta.tolist()):
            return refused
        return next(
            (found for check, given in self._checks if (found := check(self, *given, proposal)) is not None), None
        )

    def _judge_range(self, lower: Array, upper: Array, proposal: Proposal) -> Refused | None:
        after = proposal.q + proposal.delta
        joint = _worst(_beyond(after, lower, upper), _beyond(proposal.q, lower, upper))
        if joint is None:
            return None
        what = f"{self._task.joint_names[joint]} would be at {after[joint]:.6g} rad"
        return Refused(Code.JOINT_RANGE, what, f"{lower[joint]:.6g} to {upper[joint]:.6g} rad")

    def _judge_velocity(self, largest: Array, proposal: Proposal) -> Refused | None:
        rate = np.abs(proposal.delta) / self._period
        joint = _worst(rate, largest * (1.0 + ROUNDING))
        if joint is None:
            return None
        what = f"{self._task.joint_names[joint]} would turn at {rate[joint]:.6g} rad/s"
        return Refused(Code.VELOCITY, what, f"at most {largest[joint]:g} rad/s")

    def _judge_acceleration(self, largest: Array, proposal: Proposal) -> Refused | None:
        lower, upper = np.minimum(proposal.previous, 0.0), np.maximum(proposal.previous, 0.0)
        growth = _beyond(proposal.delta, lower, upper) / self._period**2
        joint = _worst(growth, largest * (1.0 + ROUNDING))
        if joint is None:
            return None
        what = f"{self._task.joint_names[joint]} would speed up by {growth[joint]:.6g} rad/s²"
        return Refused(Code.ACCELERATION, what, f"at most {largest[joint]:g} rad/s²")

    def _judge_tip(self, chain: Chain, proposal: Proposal) -> Refused | None:
        share = np.linspace(0.0, 1.0, WAYPOINTS)[:, None]
        path = chain.position(proposal.q + share * proposal.delta)  # (WAYPOINTS, 3)
        limits = self._limits
        if limits.tip_lower:
            outside = _beyond(path, np.array(limits.tip_lower), np.array(limits.tip_upper)).max(axis=1)
            if (point := _deeper(outside)) is not None:
                accepted = f"{list(limits.tip_lower)} to {list(limits.tip_upper)} m"
                return Refused(
                    Code.WORKSPACE, f"the end effector would leave its workspace at {_at(path[point])}", accepted
                )
        for zone in limits.keep_out:
            if (point := _deeper(depth(zone, path))) is not None:
                what = f"the end effector would be in a keep-out {zone.shape} at {_at(path[point])}"
                return Refused(Code.KEEP_OUT, what, f"out of {list(zone.size)} m around {list(zone.centre)} m")
        return None

    def _judge_collisions(self, touches: Touches, proposal: Proposal) -> Refused | None:
        after = touches(proposal.q + proposal.delta)
        before = touches(proposal.q) if after else {}
        for contact, deep in after.items():
            if deep > before.get(contact, 0.0) + SLACK:
                code = Code.CONTACT if contact.other == FLOOR else Code.SELF_COLLISION
                return Refused(code, f"{contact.link} would touch {contact.other}", "no contact")
        return None


def depth(zone: Zone, points: ArrayLike) -> Array:
    """How deep points lie in a zone (m), negative outside: (..., 3) -> (...).

    Inside it is the distance to the surface, outside at most that.
    """
    offset = np.asarray(points, dtype=np.float64) - zone.centre
    if zone.shape == "sphere":
        inside: Array = zone.size[0] - np.linalg.norm(offset, axis=-1)
    elif zone.shape == "box":
        inside = (np.array(zone.size) / 2.0 - np.abs(offset)).min(axis=-1)
    else:
        radius, height = zone.size
        aside = radius - np.hypot(offset[..., 0], offset[..., 1])
        inside = np.minimum(aside, height / 2.0 - np.abs(offset[..., 2]))
    return inside


def _beyond(values: Array, lower: Array, upper: Array) -> Array:
    """How far values lie outside closed intervals, 0 inside."""
    return np.maximum(np.maximum(lower - values, values - upper), 0.0)


def _worst(values: Array, allowed: Array) -> int | None:
    """Index of the value that is furthest above what is allowed for it."""
    excess = values - allowed
    worst = int(excess.argmax())
    return worst if excess[worst] > SLACK else None


def _deeper(depths: Array) -> int | None:
    """Index of the deepest point of a path, if the path leads deeper than where it begins."""
    deepest = int(depths.argmax())
    return deepest if depths[deepest] > max(float(depths[0]), 0.0) + SLACK else None


def _at(point: Array) -> str:
    return "({:.3f}, {:.3f}, {:.3f}) m".format(*point)
