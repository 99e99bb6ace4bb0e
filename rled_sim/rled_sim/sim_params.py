"""Parameters of the simulation node, and the simulation that they describe."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rled_msgs_py.params import param

from rled_sim.driver import Rules
from rled_sim.robots import ROBOTS, robot_named
from rled_sim.simulation import Simulation
from rled_sim.starts import marked_joints
from rled_sim.tasks import reach_task
from rled_sim.world import World


def _fixed(default: Any, description: str, **limits: Any) -> Any:
    return param(default, description, read_only=True, **limits)


@dataclass(frozen=True)
class SimParams:
    """Parameters of the simulation node; those that a running node takes stand last."""

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
    start_points: str = _fixed("", "bag whose marked points episodes start at; empty: the robot's home")
    gui: bool = _fixed(False, "show PyBullet's window")
    # measured with busy processors: 11 of 32 times it took more than 1 s, never more than 2.3 s
    discovery_wait: float = _fixed(3.0, "time to look for another simulation in the graph (s)", low=0.0, high=60.0)
    marker_rate: float = _fixed(5.0, "markers per second of real time; 0: none", low=0.0, high=50.0)
    seed: int = param(0, "seed of the random draws; a change takes effect at the next ~/reset", low=0, high=2**63 - 1)
    auto_reset: bool = param(True, "begin the next episode at once; otherwise wait for ~/reset")
    command_timeout: float = param(0.1, "real time: oldest state that a command may answer (s)", low=0.001, high=10.0)

    def rules(self) -> Rules:
        """What of them the driver needs."""
        return Rules(self.mode, round(self.command_timeout * 1e9), self.auto_reset)  # type: ignore[arg-type]


def simulation_of(params: SimParams) -> Simulation:
    """Open the simulation that the parameters describe.

    Raises:
        RledError: a bag without start points for this robot, or no display for the window.
    """
    robot = robot_named(params.robot)
    task = reach_task(
        robot,
        reward=params.reward,  # type: ignore[arg-type]
        targets_per_episode=_chosen(params.targets_per_episode),
        max_steps=_chosen(params.max_steps),
        period=round(params.period * 1e9),
    )
    starts = marked_joints(Path(params.start_points), task.description) if params.start_points else None
    world = World(robot, params.transition, task.description.period * 1e-9, params.gui)  # type: ignore[arg-type]
    return Simulation(world, task, starts)


def _chosen(number: int) -> int | None:
    return None if number < 0 else number
