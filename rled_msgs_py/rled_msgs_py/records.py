"""Frozen records of what travels on the topics, checked when they are made.

Stamps are nanoseconds of simulation time. Arrays are read-only float64. Orientation quaternions are
(x, y, z, w), as in geometry_msgs (REP 103 for units and axes).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum

import numpy as np

from rled_msgs_py.errors import ContractError
from rled_msgs_py.joint_names import check_names, find_by_name, order_by_name, unknown_joint
from rled_msgs_py.vectors import Vector, finite_vector, is_finite, sized_vector

UNIT_TOLERANCE = 1e-3
"""How far the squared norm of an orientation may be from 1."""


@dataclass(frozen=True, eq=False)
class JointSample:
    """Joint positions and velocities at one instant, of the robot's joints and whatever others their publisher has.

    What is used is judged where it is used (``ordered``): a driver says NaN of a gripper that it cannot read.

    Attributes:
        stamp: simulation time (ns).
        names: joint names, n of them.
        position: joint angles (rad), shape (n,); not finite where the driver does not know.
        velocity: joint rates (rad/s), shape (n,); NaN where they are not known.
    """

    stamp: int
    names: tuple[str, ...]
    position: Vector
    velocity: Vector

    def __post_init__(self) -> None:
        check_names(self.names, "a joint sample")
        object.__setattr__(self, "position", sized_vector(self.position, len(self.names), "position"))
        object.__setattr__(self, "velocity", sized_vector(self.velocity, len(self.names), "velocity"))

    def ordered(self, names: tuple[str, ...]) -> "JointSample":
        """The joints ``names`` of this sample, in their order; other joints are passed over.

        Raises:
            ContractError: one is missing, or its position is not finite.
        """
        chosen = self
        if names != self.names:
            order = find_by_name(self.names, names, f"the joint state of {self.stamp} ns")
            chosen = JointSample(self.stamp, names, self.position[order], self.velocity[order])
        if not is_finite(chosen.position):
            raise unknown_joint(f"the joint state of {self.stamp} ns", names, chosen.position)
        return chosen


@dataclass(frozen=True, eq=False)
class PoseSample:
    """A pose in space at one instant.

    Attributes:
        stamp: simulation time (ns).
        frame: frame that the pose is expressed in.
        position: origin (m), shape (3,).
        orientation: unit quaternion (x, y, z, w), shape (4,).
    """

    stamp: int
    frame: str
    position: Vector
    orientation: Vector = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", finite_vector(self.position, 3, "position"))
        orientation = finite_vector(self.orientation, 4, "orientation")
        square = sum(value * value for value in orientation.tolist())
        if abs(square - 1.0) > UNIT_TOLERANCE:
            raise ContractError(f"orientation {orientation.tolist()} has norm {math.sqrt(square):.3g}", "1")
        object.__setattr__(self, "orientation", orientation)


@dataclass(frozen=True, eq=False)
class DeltaCommand:
    """Joint displacements asked for, in answer to the state of the same stamp.

    Attributes:
        stamp: stamp of the state that this answers (ns).
        names: joint names, n of them.
        delta: joint displacements Δq (rad), shape (n,).
    """

    stamp: int
    names: tuple[str, ...]
    delta: Vector

    def __post_init__(self) -> None:
        check_names(self.names, "a delta command")
        object.__setattr__(self, "delta", finite_vector(self.delta, len(self.names), "delta"))

    def ordered(self, names: tuple[str, ...]) -> "DeltaCommand":
        """The same command with its joints in the order of ``names``."""
        if names == self.names:
            return self
        order = order_by_name(self.names, names, "a delta command")
        return DeltaCommand(self.stamp, names, self.delta[order])


class Actor(Enum):
    """Who moves the robot in one step."""

    AGENT = "agent"
    EXPERT = "expert"
    HUMAN = "human"
    HOLD = "hold"


class Level(Enum):
    """Severity, with the values of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


class GateCode(IntEnum):
    """Why somebody moves the robot, for programs and plots."""

    SURE = 0
    """The agent's uncertainty is below the threshold."""
    UNGATED = 1
    """The policy has no uncertainty, so it always acts."""
    UNSURE = 2
    """The agent's uncertainty is not below the threshold: the expert stands in, or the robot holds."""
    LIMIT = 3
    """A limit forbids the displacement: the expert stands in, or the robot holds."""
    HUMAN = 4
    """A person drives."""
    ASKING = 5
    """The agent is unsure, and a person is asked before the expert stands in."""
    STALE = 6
    """The state is too old to act on."""
    STOPPED = 7
    """The emergency stop is on."""
    DRAWN = 8
    """The expert was drawn to drive this episode (biased exploration)."""


@dataclass(frozen=True)
class GateDecision:
    """One decision of the safety gate.

    Attributes:
        stamp: stamp of the state decided on (ns).
        level: OK when the agent or the expert as chosen policy acts, WARN when somebody stands in, ERROR on hold.
        actor: who moves the robot.
        reason: why, in words.
        uncertainty: u_t of Eq. 4.39 (1), NaN when it was not computed.
        threshold: ξ of Eq. 4.40 (1), NaN when no threshold applies.
        measure: name of the uncertainty measure, or ``none``.
        episode: episode counter of the task.
        step: step within the episode.
        code: why, for programs.
    """

    stamp: int
    level: Level
    actor: Actor
    reason: str
    uncertainty: float
    threshold: float
    measure: str
    episode: int
    step: int
    code: GateCode


@dataclass(frozen=True)
class TaskStatus:
    """What the task says of the tick of the same stamp.

    Attributes:
        stamp: simulation time (ns).
        episode: episodes begun before this one.
        step: steps taken in this episode.
        reward: reward of the transition that led here (1); 0 at the first tick of an episode.
        targets_reached: targets reached in this episode.
        risky: this state is one that the task counts as a violation.
        violations: risky states in this episode.
        terminated: the task is done.
        truncated: the step limit was met.
        refused: the limit that forbade the displacement asked for, so that the robot stayed; empty when none did.
    """

    stamp: int
    episode: int
    step: int
    reward: float
    targets_reached: int
    risky: bool
    violations: int
    terminated: bool
    truncated: bool
    refused: str = ""

    def __post_init__(self) -> None:
        if not math.isfinite(self.reward):
            raise ContractError(f"reward is {self.reward}", "a finite number")


@dataclass(frozen=True)
class Text:
    """A latched text: a URDF on ``robot_description``, JSON on ``task_description``."""

    data: str


@dataclass(frozen=True)
class Health:
    """One node's health, at about 1 Hz (REP 107).

    Attributes:
        stamp: time (ns).
        level: worst condition.
        name: node and part.
        message: summary in words.
        values: metrics by name.
    """

    stamp: int
    level: Level
    name: str
    message: str
    values: Mapping[str, str]


Record = JointSample | PoseSample | DeltaCommand | GateDecision | TaskStatus | Text | Health
