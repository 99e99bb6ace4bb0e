"""What a task asks for, self-described: JSON on the latched topic ``task_description``, and so in every bag."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.arrays import namespace
from rled_msgs_py.errors import ContractError
from rled_msgs_py.joint_names import check_names
from rled_msgs_py.task_limits import NO_LIMITS, Limits
from rled_msgs_py.untrusted import read_json
from rled_msgs_py.validation import check_fields, from_object

Observation = Literal["displacement_and_joints", "position_and_target"]
Reward = Literal["dense", "sparse"]
Tensor = TypeVar("Tensor")
"""``torch.Tensor``, which is not imported here."""


@dataclass(frozen=True)
class TaskDescription:
    """Everything that an operator, a learner or a bag reader must know of robot and task.

    Attributes:
        robot: robot's name.
        task: task's name.
        frame: frame of all positions.
        tip_link: link whose origin is the end effector.
        joint_names: the n actuated joints, in the order of every vector.
        joint_lower: lower joint limits (rad), n.
        joint_upper: upper joint limits (rad), n.
        max_delta: Δq_max, largest joint displacement of one step (rad).
        axes: indices of the m position components that the task uses.
        workspace_lower: minimum end-effector position (m), m.
        workspace_upper: maximum end-effector position (m), m.
        observation: how a state becomes a vector, see ``observe``.
        reward: reward function of section 4.1.3.
        reward_reached: u, paid when a target is reached (1).
        tolerance: ε_x, compared with the squared distance (m²).
        targets_per_episode: targets that end an episode; 0 never ends it.
        max_steps: steps after which an episode is cut; 0 never cuts it.
        period: simulation time between ticks (ns).
        limits: what motion has to keep within besides; JSON without it, as in older bags, has none.
    """

    robot: str
    task: str
    frame: str
    tip_link: str
    joint_names: tuple[str, ...]
    joint_lower: tuple[float, ...]
    joint_upper: tuple[float, ...]
    max_delta: float
    axes: tuple[int, ...]
    workspace_lower: tuple[float, ...]
    workspace_upper: tuple[float, ...]
    observation: Observation
    reward: Reward
    reward_reached: float
    tolerance: float
    targets_per_episode: int
    max_steps: int
    period: int
    limits: Limits = NO_LIMITS

    def __post_init__(self) -> None:
        check_fields(self)
        check_names(self.joint_names, "the task description")
        n, m = len(self.joint_names), len(self.axes)
        sizes = {"joint_lower": n, "joint_upper": n, "workspace_lower": m, "workspace_upper": m}
        for name, size in sizes.items():
            if len(getattr(self, name)) != size:
                raise ContractError(f"{name} has {len(getattr(self, name))} values", str(size))
        for what in ("joint", "workspace"):
            lower, upper = getattr(self, f"{what}_lower"), getattr(self, f"{what}_upper")
            if any(low > high for low, high in zip(lower, upper, strict=True)):
                raise ContractError(f"{what}_lower {list(lower)}", f"at most {what}_upper {list(upper)}")
        if not self.axes or len(set(self.axes)) != m or not set(self.axes) <= {0, 1, 2}:
            raise ContractError(f"axes are {list(self.axes)}", "distinct ones of 0, 1, 2")
        for name in ("max_delta", "tolerance", "period"):
            if getattr(self, name) <= 0:
                raise ContractError(f"{name} is {getattr(self, name)}", "more than 0")
        for name in ("targets_per_episode", "max_steps"):
            if getattr(self, name) < 0:
                raise ContractError(f"{name} is {getattr(self, name)}", "0 or more")
        self.limits.require_joints(n)

    @property
    def action_size(self) -> int:
        """n, joints moved."""
        return len(self.joint_names)

    @cached_property
    def _indices(self) -> NDArray[np.intp]:
        return np.array(self.axes)

    @overload
    def observe(self, q: NDArray[Any], position: NDArray[Any], target: NDArray[Any]) -> NDArray[np.float64]: ...
    @overload
    def observe(self, q: Tensor, position: Tensor, target: Tensor) -> Tensor: ...
    def observe(self, q: Any, position: Any, target: Any) -> Any:
        """The state vector x that a policy sees, for one state or a batch; numpy arrays or torch tensors.

        Args:
            q: joint angles (rad), shape (..., n).
            position: end effector (m), shape (..., 3).
            target: target (m), shape (..., 3).

        Returns:
            ``displacement_and_joints``: [X_T − X; q] of section 4.1.3, shape (..., m + n).
            ``position_and_target``: [X; X_T] of section 4.2.3, shape (..., 2m).
        """
        xp = namespace(q)
        if self.observation == "displacement_and_joints":
            return xp.concatenate([self._along_axes(target - position), q], -1)
        return xp.concatenate([self._along_axes(position), self._along_axes(target)], -1)

    def _along_axes(self, points: Any) -> Any:
        """The components that the task uses (m): (..., 3) -> (..., m)."""
        if isinstance(points, np.ndarray):
            return points.take(self._indices, -1)
        return namespace(points).stack([points[..., axis] for axis in self.axes], -1)  # no index to copy to a device

    def observation_bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Minimum and maximum observation inside the workspace and the joint limits."""
        lower, upper = np.array(self.workspace_lower), np.array(self.workspace_upper)
        if self.observation == "displacement_and_joints":
            span = upper - lower
            return np.concatenate([-span, self.joint_lower]), np.concatenate([span, self.joint_upper])
        return np.concatenate([lower, lower]), np.concatenate([upper, upper])

    def to_json(self) -> str:
        """JSON text of the description."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> "TaskDescription":
        """Read ``to_json``'s text.

        Raises:
            ContractError: not JSON, or fields missing, unknown or of a wrong kind.
        """
        what = "the task description"
        return from_object(TaskDescription, read_json(text, what), what, {"limits": NO_LIMITS})

    def require_same_robot(self, other: "TaskDescription", whose: str) -> None:
        """Refuse another robot's description.

        Raises:
            ContractError: joints, observation or Δq_max differ.
        """
        for name in ("robot", "joint_names", "observation", "max_delta"):
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine != theirs:
                raise ContractError(f"{whose} is for {name} {_plain(theirs)}", _plain(mine))


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, Sequence) and not isinstance(value, str) else str(value)
