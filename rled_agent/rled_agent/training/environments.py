"""Making the environments that a run acts in and is looked at in."""

from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription
from rled_sim.vector.reach import ReachBatch

from rled_agent.nn.scaling import Floats
from rled_agent.training.config import TrainConfig
from rled_agent.training.environment_batch import Environment, EnvironmentBatch, OneByOne, ReachEnvironments
from rled_sim import ENVIRONMENTS  # which registers them

Joints = NDArray[np.float64]
Box = gymnasium.spaces.Box


def _robot_of(env: str) -> str | None:
    """The robot of one of this project's environments, else None."""
    return next((robot for robot, name in ENVIRONMENTS.items() if name == env), None)


def make_batch(
    config: TrainConfig, start_joints: Joints | None, count: int, device: torch.device, episodes: int = 1
) -> EnvironmentBatch:
    """Environments of a run, stepped together; those of this project are arrays, any other is stepped by itself.

    Args:
        config: names environment, reward, targets and faults.
        start_joints: joint angles that episodes start at (rad), shape (k, n): those of ζᵃ (Algorithm 2).
        count: how many.
        device: that tensors are on.
        episodes: environments in the place of each, where they are arrays and many cost little more than one.

    Raises:
        RledError: as ``make_environment``.
    """
    robot = _robot_of(config.env)
    if robot is None or config.reward == "own":
        return OneByOne([make_environment(config, start_joints) for _ in range(count)], device)
    batch = ReachBatch(
        robot,
        count * episodes,
        reward=config.reward,
        start_joints=start_joints,
        target_spread=config.target_spread,
        faults=config.faults,
        device=None if device.type == "cpu" else str(device),
    )
    return ReachEnvironments(batch, device)


def make_environment(config: TrainConfig, start_joints: Joints | None) -> Environment:
    """The environment of a run.

    Args:
        config: names environment, reward, targets and faults.
        start_joints: joint angles that episodes start at (rad), shape (k, n): those of ζᵃ (Algorithm 2).

    Raises:
        RledError: no such environment, or spaces that the learner can't use.
    """
    options: dict[str, Any] = {} if config.reward == "own" else {"reward": config.reward}
    if config.target_spread:
        options["target_spread"] = config.target_spread
    if config.faults.any:
        options["faults"] = config.faults
    if start_joints is not None:
        options["start_joints"] = start_joints
    try:
        env = gymnasium.make(config.env, **options)
    except (gymnasium.error.Error, ImportError, ValueError) as error:
        why = " ".join(str(error).split())[:200]
        raise RledError(
            f"env '{config.env[:80]}': {why}", "an id that Gymnasium knows, as rled/PandaReach-v0"
        ) from None
    except TypeError:
        taken = ", ".join(options)
        raise RledError(f"env '{config.env}' takes no {taken}", "--reward own, without --bag") from None
    check_spaces(env, config.method.name)
    return env


def environment_of(robot: str) -> str:
    """Name of a robot's environment.

    Raises:
        RledError: it has none.
    """
    if robot not in ENVIRONMENTS:
        raise RledError(f"robot '{robot[:80]}' has no environment", f"one of {', '.join(ENVIRONMENTS)}")
    return ENVIRONMENTS[robot]


def require_robot_of(demonstrations: TaskDescription, env: str, what: str) -> None:
    """Refuse demonstrations of another robot than an environment's.

    Args:
        demonstrations: their task.
        env: name of the environment; one of somebody else has no robot.
        what: they are in, for the error.

    Raises:
        RledError: names the environment that fits them.
    """
    robot = _robot_of(env)
    if robot is not None and demonstrations.robot != robot:
        found = f"{what} is of robot {demonstrations.robot}, env {env} of {robot}"
        raise RledError(found, f"a bag of {robot}", f"or --env {environment_of(demonstrations.robot)}")


def check_spaces(env: Environment, who: str) -> None:
    """Refuse spaces other than flat boxes.

    Raises:
        RledError: names the space, and the method that it does not serve.
    """
    for name, space in (("action", env.action_space), ("observation", env.observation_space)):
        if not isinstance(space, Box) or len(space.shape) != 1:
            raise RledError(f"{who} cannot serve the {name} space {space}", "a Box of one dimension")


def bounds(space: gymnasium.Space[Any]) -> tuple[Floats, Floats]:
    """Least and greatest member of a box, shape (k,) each."""
    assert isinstance(space, Box)
    return space.low.astype(np.float64), space.high.astype(np.float64)
