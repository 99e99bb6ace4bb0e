"""What a robot's motion has to keep within besides Δq_max; every limit is off unless given."""

from dataclasses import dataclass
from typing import Literal

from rled_msgs_py.errors import ContractError
from rled_msgs_py.validation import check_fields

Shape = Literal["box", "sphere", "cylinder"]

SIZES: dict[Shape, tuple[str, ...]] = {
    "box": ("length along x", "along y", "along z"),
    "sphere": ("radius",),
    "cylinder": ("radius", "height"),
}
"""What the size of a zone says, by its shape; a cylinder stands upright."""


@dataclass(frozen=True)
class Zone:
    """A body that the end effector stays out of, in the task's frame.

    Attributes:
        shape: ``box`` along the axes, ``sphere``, or upright ``cylinder``.
        centre: its centre (m), 3.
        size: see ``SIZES`` (m).
    """

    shape: Shape
    centre: tuple[float, ...]
    size: tuple[float, ...]

    def __post_init__(self) -> None:
        check_fields(self)
        if len(self.centre) != 3:
            raise ContractError(f"centre of a keep-out zone {list(self.centre)}", "3 numbers (m)")
        if len(self.size) != len(SIZES[self.shape]) or min(self.size) <= 0.0:
            raise ContractError(
                f"size of a {self.shape} {list(self.size)}", f"{', '.join(SIZES[self.shape])}, each more than 0 m"
            )


@dataclass(frozen=True)
class Limits:
    """What displacements are judged by, see ``rled_sim.motion_guard``; an empty tuple is no limit.

    Attributes:
        joint_lower: minimum joint angles that may be asked for (rad), n.
        joint_upper: maximum joint angles that may be asked for (rad), n.
        velocity: maximum joint rates |Δq| / period (rad/s), n.
        acceleration: maximum growth of a joint rate from one period to the next, over the period (rad/s²), n.
        tip_lower: minimum end-effector position (m), 3.
        tip_upper: maximum end-effector position (m), 3.
        keep_out: zones that the end effector stays out of.
        collisions: the robot must not touch itself or the floor.
    """

    joint_lower: tuple[float, ...] = ()
    joint_upper: tuple[float, ...] = ()
    velocity: tuple[float, ...] = ()
    acceleration: tuple[float, ...] = ()
    tip_lower: tuple[float, ...] = ()
    tip_upper: tuple[float, ...] = ()
    keep_out: tuple[Zone, ...] = ()
    collisions: bool = False

    def __post_init__(self) -> None:
        check_fields(self)
        for what in ("joint", "tip"):
            lower, upper = getattr(self, f"{what}_lower"), getattr(self, f"{what}_upper")
            if len(lower) != len(upper) or any(low > high for low, high in zip(lower, upper, strict=True)):
                raise ContractError(f"limits: {what}_lower {list(lower)}", f"at most {what}_upper {list(upper)}")
        if len(self.tip_lower) not in (0, 3):
            raise ContractError(f"limits: tip_lower {list(self.tip_lower)}", "3 numbers (m)")
        for what in ("velocity", "acceleration"):
            if any(each <= 0.0 for each in getattr(self, what)):
                raise ContractError(f"limits: {what} {list(getattr(self, what))}", "more than 0")

    def require_joints(self, n: int) -> None:
        """Refuse limits of another number of joints.

        Raises:
            ContractError: names the limit.
        """
        for name in ("joint_lower", "velocity", "acceleration"):
            if len(getattr(self, name)) not in (0, n):
                raise ContractError(f"limits: {name} has {len(getattr(self, name))} values", str(n))


NO_LIMITS = Limits()
