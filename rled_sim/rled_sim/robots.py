"""The robots by name: URDF, joints, limits, home."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from pybullet_data import getDataPath
from rled_msgs_py.errors import RledError

from rled_sim.joints import Joint, joints_to
from rled_sim.kinematics import Chain
from rled_sim.published_urdf import publishable


@dataclass(frozen=True)
class Camera:
    """Where a picture of the robot is taken from.

    Attributes:
        target: point looked at (m).
        distance: from it (m).
        yaw: about z (degrees).
        pitch: above the horizon when negative (degrees).
    """

    target: tuple[float, float, float]
    distance: float
    yaw: float
    pitch: float


@dataclass(frozen=True)
class Robot:
    """A robot with a fixed base at the origin of the frame ``world``.

    Attributes:
        name: what a person calls it.
        urdf: its URDF file.
        joint_names: the n joints that a policy moves, in the order of every vector.
        tip_link: link whose origin is the end effector.
        home: joint angles at rest (rad), n.
        max_delta: Δq_max, largest joint displacement of one step (rad).
        camera: a view of the whole robot.
        held: the other joints that can move, kept at a position (rad or m).
    """

    name: str
    urdf: Path
    joint_names: tuple[str, ...]
    tip_link: str
    home: tuple[float, ...]
    max_delta: float
    camera: Camera
    held: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def description(self) -> str:
        """URDF text as it is published: it stands on ``world``, and what is held is fixed."""
        return publishable(self.urdf, self.joint_names, self.held)

    @cached_property
    def chain(self) -> Chain:
        """Kinematics from the base to the tip link."""
        return Chain.from_urdf(self.description, self.tip_link, self.joint_names)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """The n joints, with their limits, in the order of ``joint_names``."""
        by_name = {joint.name: joint for joint in joints_to(self.description, self.tip_link)}
        return tuple(by_name[name] for name in self.joint_names)

    @property
    def lower(self) -> tuple[float, ...]:
        """Lower joint limits (rad), n."""
        return tuple(joint.lower for joint in self.joints)

    @property
    def upper(self) -> tuple[float, ...]:
        """Upper joint limits (rad), n."""
        return tuple(joint.upper for joint in self.joints)


ROBOTS: dict[str, Robot] = {
    "panda": Robot(
        name="panda",
        urdf=Path(getDataPath()) / "franka_panda" / "panda.urdf",
        joint_names=tuple(f"panda_joint{number}" for number in range(1, 8)),
        tip_link="panda_grasptarget",
        home=(0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.785),
        max_delta=0.04,
        camera=Camera((0.25, 0.0, 0.4), 1.5, 60.0, -20.0),
        held={"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04},
    ),
    "planar": Robot(
        name="planar",
        urdf=Path(__file__).parent / "urdf" / "planar.urdf",
        joint_names=("shoulder", "elbow"),
        tip_link="tip",
        home=(-0.9, 1.8),
        max_delta=0.1,
        camera=Camera((0.4, 0.0, 0.1), 1.3, -90.0, -70.0),
    ),
}


def robot_named(name: str) -> Robot:
    """The robot of that name.

    Raises:
        RledError: there is none.
    """
    if name not in ROBOTS:
        raise RledError(f"unknown robot '{name}'", ", ".join(ROBOTS), "choose one of these")
    return ROBOTS[name]
