"""Parameters of the simulation node, and the simulation that they describe."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rled_msgs_py.errors import RledError
from rled_msgs_py.params import param
from rled_msgs_py.task_limits import Limits, Zone

from rled_sim.bullet.world import World
from rled_sim.driver import Rules
from rled_sim.faults import Faults, hidden_names
from rled_sim.robots import ROBOTS, Robot, robot_named
from rled_sim.simulation import Simulation
from rled_sim.starts import marked_joints
from rled_sim.tasks import MAX_TARGET_SPREAD, reach_task, require_task


def _fixed(default: Any, description: str, **limits: Any) -> Any:
    return param(default, description, read_only=True, **limits)


@dataclass(frozen=True)
class _OwnParams:
    robot: str = _fixed("panda", "robot to simulate", choices=tuple(ROBOTS))
    mode: str = _fixed(
        "lockstep",
        "lockstep: wait for the answer to each tick; real_time: tick by the clock",
        choices=("lockstep", "real_time"),
    )
    transition: str = _fixed(
        "kinematic", "kinematic: displace the joints; motors: physics", choices=("kinematic", "motors")
    )
    reward: str = _fixed("dense", "reward function", choices=("dense", "sparse"))
    targets_per_episode: int = _fixed(
        -1, "targets that end an episode; 0: endless, -1: the task's own", low=-1, high=10**6
    )
    max_steps: int = _fixed(-1, "steps that cut an episode; 0: never, -1: the task's own", low=-1, high=10**9)
    period: float = _fixed(0.02, "simulation time between two ticks (s)", low=0.001, high=1.0)
    target_spread: float = _fixed(
        0.0,
        "how far beside the curve a target lies at most, along each axis of the task (m)",
        low=0.0,
        high=MAX_TARGET_SPREAD,
    )
    start_points: str = _fixed("", "bag whose marked points episodes start at; empty: the robot's home")
    joint_margin: float = _fixed(
        -1.0,
        "refuse angles nearer to the joint limits (rad); below 0: clip at them, as the thesis does",
        low=-1.0,
        high=1.0,
    )
    velocity_share: float = _fixed(0.0, "refuse joint rates above this share of the URDF's; 0: any", low=0.0, high=1.0)
    acceleration: float = _fixed(0.0, "refuse to speed a joint up by more (rad/s²); 0: by any", low=0.0, high=1e6)
    workspace: str = _fixed("", "box that the end effector stays in: lower x y z, upper x y z (m); empty: any")
    keep_out: str = _fixed(
        "", "zones that it stays out of: 'box X Y Z LX LY LZ; sphere X Y Z R; cylinder X Y Z R H', centre first (m)"
    )
    collisions: bool = _fixed(False, "refuse what would touch the floor or the robot itself")
    gui: bool = _fixed(False, "show PyBullet's window")
    # measured with busy processors: 11 of 32 times it took more than 1 s, never more than 2.3 s
    discovery_wait: float = _fixed(3.0, "time to look for another simulation in the graph (s)", low=0.0, high=60.0)
    marker_rate: float = _fixed(5.0, "markers per second of real time; 0: none", low=0.0, high=50.0)
    seed: int = param(0, "seed of the random draws; a change takes effect at the next ~/reset", low=0, high=2**63 - 1)
    auto_reset: bool = param(True, "begin the next episode at once; otherwise wait for ~/reset")
    # a command computed from a state k periods old may overshoot by k steps
    command_timeout: float = param(
        0.0, "real time: oldest state that a command may answer (s); 0: two periods", low=0.0, high=10.0
    )


@dataclass(frozen=True)
class SimParams(Faults, _OwnParams):
    """Parameters of the simulation node: its own, those that a running node takes last, then the faults."""

    def __post_init__(self) -> None:
        super().__post_init__()
        robot = robot_named(self.robot)
        require_task(robot.name)
        hidden_names(self.hidden, robot.joint_names)

    def rules(self) -> Rules:
        """What of them the driver needs."""
        timeout = round((self.command_timeout or 2.0 * self.period) * 1e9)
        return Rules(self.mode, timeout, self.auto_reset)  # type: ignore[arg-type]


def simulation_of(params: SimParams) -> Simulation:
    """Open the simulation that the parameters describe.

    Raises:
        RledError: a bag without start points for this robot, limits that make no sense, or no display for the window.
    """
    robot = robot_named(params.robot)
    task = reach_task(
        robot,
        reward=params.reward,  # type: ignore[arg-type]
        targets_per_episode=_chosen(params.targets_per_episode),
        max_steps=_chosen(params.max_steps),
        period=round(params.period * 1e9),
        limits=limits_of(params, robot),
        target_spread=params.target_spread,
    )
    starts = marked_joints(Path(params.start_points), task.description) if params.start_points else None
    world = World(robot, params.transition, task.description.period * 1e-9, params.gui)  # type: ignore[arg-type]
    try:
        return Simulation(world, task, starts)
    except BaseException:
        world.close()
        raise


def limits_of(params: SimParams, robot: Robot) -> Limits:
    """The limits that the parameters describe.

    Raises:
        RledError: a box or a zone that cannot be read.
    """
    n, margin = len(robot.joints), params.joint_margin
    box = _numbers(params.workspace.split(), params.workspace)
    return Limits(
        joint_lower=tuple(each + margin for each in robot.lower) if margin >= 0.0 else (),
        joint_upper=tuple(each - margin for each in robot.upper) if margin >= 0.0 else (),
        velocity=tuple(params.velocity_share * each.velocity for each in robot.joints) if params.velocity_share else (),
        acceleration=(params.acceleration,) * n if params.acceleration else (),
        tip_lower=box[:3],
        tip_upper=box[3:],
        keep_out=tuple(_zone(each) for each in params.keep_out.split(";") if each.strip()),
        collisions=params.collisions,
    )


def _zone(text: str) -> Zone:
    shape, *numbers = text.split()
    centre_and_size = _numbers(numbers, text)
    return Zone(shape, centre_and_size[:3], centre_and_size[3:])  # type: ignore[arg-type]


def _numbers(words: Sequence[str], text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in words)
    except ValueError:
        raise RledError(f"numbers of '{text.strip()}'", "metres, separated by blanks") from None


def _chosen(number: int) -> int | None:
    return None if number < 0 else number
