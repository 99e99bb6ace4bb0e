"""The reach tasks of sections 4.1.3 and 4.2.3: targets, rewards, risky states."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import ContractError
from rled_msgs_py.task import Reward, TaskDescription
from rled_msgs_py.task_limits import NO_LIMITS, Limits

from rled_sim.draws import index, offset
from rled_sim.lemniscate import lemniscate
from rled_sim.plant import Point
from rled_sim.robots import Robot, robot_named

Numbers = Any
"""A number for one state, an array of them for many."""
Columns = Sequence[Numbers]
"""Joint angles (rad), n, or coordinates (m), 3: of one state, or of many."""
Risk = Callable[[Columns, Columns], Any]
"""Tells from joint angles and tip whether a state is risky: one answer, or an array of them."""

FRAME = "world"
PERIOD = 20_000_000
"""Simulation time between ticks (ns)."""
FLOOR_CLEARANCE = 0.05
"""Panda: a tool lower than this above the floor (m) is a risky state."""
MIN_RADIUS, MAX_RADIUS = 0.40, 0.95
"""Planar: a tip nearer to the base than the first or farther than the second (m) is a risky state."""
MAX_SHOULDER = 2.0
"""Planar: a shoulder turned further than this either way (rad) is a risky state."""
MAX_TARGET_SPREAD = 1.0
"""Farther beside the curve (m) no target of these robots makes sense."""


class Judged(NamedTuple):
    """What a task says of a state that a transition led to, or of many.

    Attributes:
        reward: of the transition.
        reached: the target is reached.
        risky: the state is risky.
    """

    reward: Any
    reached: Any
    risky: Any


@dataclass(frozen=True)
class ReachTask:
    """Reach one target after another with the end effector; its orientation does not matter.

    The reward of a transition that ends in x' with squared distance ‖e‖² from the target is

    - dense: -‖e‖², plus u when ‖e‖² < ε_x;
    - sparse: u when ‖e‖² < ε_x, else 0;

    and ``penalty`` less in a risky state. The thesis prints the dense reward without the minus, which would pay for
    staying away.

    Attributes:
        description: what is published of the task.
        targets: points that targets are drawn from (m), shape (k, 3).
        risky: tells from joint angles and tip whether a state is risky.
        penalty: taken off the reward in a risky state (1).
        target_spread: how far beside its point a target lies at most, along each axis of the task (m).
    """

    description: TaskDescription
    targets: NDArray[np.float64]
    risky: Risk
    penalty: float
    target_spread: float = 0.0

    @property
    def target_draws(self) -> int:
        """How many uniforms a target takes."""
        return 1 + (len(self.description.axes) if self.target_spread else 0)

    def draw_target(self, rng: np.random.Generator) -> Point:
        """One of the targets, each as likely as the other, or a point anywhere around it: ``target_draws`` uniforms."""
        point = self.targets[index(rng, len(self.targets))].tolist()
        if self.target_spread:
            for axis in self.description.axes:
                point[axis] += offset(rng.random(), self.target_spread)
        x, y, z = point
        return x, y, z

    def reward(self, squared_distance: Numbers, reached: Numbers, risky: Numbers) -> Any:
        """Reward of a transition, or of many, from the states that they led to."""
        dense = float(self.description.reward == "dense")
        return reached * self.description.reward_reached - dense * squared_distance - risky * self.penalty

    def judge_columns(self, q: Columns, position: Columns, target: Columns) -> Judged:
        """Judge the state that a transition led to: plain numbers; or many such states: an array for each number.

        Args:
            q: joint angles (rad), n.
            position: end effector (m), 3.
            target: of the transition (m), 3.
        """
        squared = squared_distance(position, target)
        reached, risky = squared < self.description.tolerance, self.risky(q, position)
        return Judged(self.reward(squared, reached, risky), reached, risky)

    def judge(self, q: Any, position: Any, target: Any) -> Judged:
        """Judge many states that transitions led to; numpy arrays or torch tensors.

        Args:
            q: joint angles (rad), shape (..., n).
            position: end effector (m), shape (..., 3).
            target: of the transition (m), shape (..., 3).

        Returns:
            Rewards, and whether a target is reached and the state is risky, each of shape (...).
        """
        return self.judge_columns(*([each[..., k] for k in range(each.shape[-1])] for each in (q, position, target)))


def squared_distance(a: Columns, b: Columns) -> Any:
    """‖a - b‖² (m²), of two points or of two arrays of points."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return x * x + y * y + z * z


def panda_risk(q: Columns, position: Columns) -> Any:
    """The tool is lower than ``FLOOR_CLEARANCE``."""
    return position[2] < FLOOR_CLEARANCE


def planar_risk(q: Columns, position: Columns) -> Any:
    """The tip is in the keep-out disc or beyond the reach, or the shoulder is turned too far.

    The distance from the base depends on the elbow alone, and falls with it, so the safe states are a box in joint
    space: a straight line between two safe joint vectors is safe, and the demonstrator never violates.
    """
    squared = position[0] * position[0] + position[1] * position[1]
    return (squared < MIN_RADIUS**2) | (squared > MAX_RADIUS**2) | (abs(q[0]) > MAX_SHOULDER)


def require_task(robot: str) -> None:
    """Refuse a robot that nothing is asked of.

    Raises:
        ContractError: says which robots have a task, and how another gets one.
    """
    if robot not in TASKS:
        remedy = f"to give it one, write a function in {__name__} and name it in TASKS"
        raise ContractError(f"robot '{robot}' has no task", f"a robot that has one: {', '.join(TASKS)}", remedy)


def reach_task(
    robot: Robot,
    *,
    reward: Reward | None = None,
    targets_per_episode: int | None = None,
    max_steps: int | None = None,
    period: int | None = None,
    limits: Limits = NO_LIMITS,
    target_spread: float = 0.0,
) -> ReachTask:
    """A robot's reach task, with the thesis's settings where nothing else is said.

    Args:
        robot: one that has a task.
        reward: ``dense`` or ``sparse``.
        targets_per_episode: targets that end an episode; 0 never ends it.
        max_steps: steps after which an episode is cut; 0 never cuts it.
        period: simulation time between ticks (ns).
        limits: what motion has to keep within.
        target_spread: how far beside the curve a target lies at most, along each axis of the task (m); the task does
            not look whether the robot reaches so far.

    Raises:
        ContractError: a robot without a task, limits of another number of joints, or a spread that is no length.
    """
    require_task(robot.name)
    if not 0.0 <= target_spread <= MAX_TARGET_SPREAD:
        raise ContractError(f"target_spread is {target_spread}", f"0 to {MAX_TARGET_SPREAD:g} m")
    task = TASKS[robot.name](robot)
    options = {
        "reward": reward,
        "targets_per_episode": targets_per_episode,
        "max_steps": max_steps,
        "period": period,
        "limits": limits,
    }
    chosen: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    return replace(task, description=replace(task.description, **chosen), target_spread=target_spread)


def task_of_description(description: TaskDescription) -> ReachTask:
    """The reach task that a description, of a bag or of a topic, was made of.

    What a description does not hold is that of its robot's task: targets, risky states, penalty.

    Raises:
        ContractError: a robot without a task, or one with other joints.
    """
    require_task(description.robot)
    task = TASKS[description.robot](robot_named(description.robot))
    if description.joint_names != task.description.joint_names:
        names = ", ".join(description.joint_names)
        raise ContractError(
            f"robot '{description.robot}' with the joints {names}", ", ".join(task.description.joint_names)
        )
    return replace(task, description=description)


def _panda(robot: Robot) -> ReachTask:
    """Section 4.1.3: 15 targets on a lemniscate across the robot's front, at most 999 steps."""
    description = _describe(
        robot,
        axes=(0, 1, 2),
        workspace_lower=(-1.0, -1.0, -0.6),
        workspace_upper=(1.0, 1.0, 1.4),
        observation="displacement_and_joints",
        reward_reached=1000.0,
        tolerance=3e-3,
        targets_per_episode=15,
        max_steps=999,
    )
    curve = lemniscate(1572, centre=(0.5, 0.0, 0.5), along=(0.0, 0.25, 0.0), across=(0.0, 0.0, 0.25))
    return ReachTask(description, curve, panda_risk, penalty=0.0)


def _planar(robot: Robot) -> ReachTask:
    """Section 4.2.3: from one point to another of a lemniscate in the plane, keeping clear of risky states."""
    description = _describe(
        robot,
        axes=(0, 1),
        workspace_lower=(-1.05, -1.05),
        workspace_upper=(1.05, 1.05),
        observation="position_and_target",
        reward_reached=10.0,
        tolerance=1e-3,
        targets_per_episode=1,
        max_steps=100,
    )
    curve = lemniscate(400, centre=(0.65, 0.0, 0.1), along=(0.0, 0.25, 0.0), across=(0.25, 0.0, 0.0))
    return ReachTask(description, curve, planar_risk, penalty=1.0)


TASKS: dict[str, Callable[[Robot], ReachTask]] = {"panda": _panda, "planar": _planar}
"""The task of each robot that has one, by the robot's name."""


def _describe(robot: Robot, **settings: Any) -> TaskDescription:
    return TaskDescription(
        robot=robot.name,
        task="reach",
        frame=FRAME,
        tip_link=robot.tip_link,
        joint_names=robot.joint_names,
        joint_lower=robot.lower,
        joint_upper=robot.upper,
        max_delta=robot.max_delta,
        reward="dense",
        period=PERIOD,
        **settings,
    )
