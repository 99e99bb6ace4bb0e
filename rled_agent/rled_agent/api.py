"""The whole way in three functions, for notebooks and other packages."""

from collections.abc import Callable
from pathlib import Path
from threading import Event

import numpy as np
from rled_sim.vector.reach import ReachBatch

from rled_agent.data.demonstrations import Demonstrations
from rled_agent.learners.cloning import CloningConfig, CurvePoint, clone_expert
from rled_agent.nn.policy import Policy
from rled_agent.training.config import TrainConfig
from rled_agent.training.evaluating import evaluate_policy
from rled_agent.training.learning import train as learn
from rled_agent.training.run import Inputs, composed
from rled_agent.training.run_directory import RunDirectory


def clone(
    demonstrations: Demonstrations,
    config: CloningConfig | None = None,
    seed: int = 0,
    progress: Callable[[CurvePoint], None] = lambda _: None,
) -> Policy:
    """The expert policy, fitted to demonstrations (Eq. 4.10); the same seed gives the same policy.

    Raises:
        RledError: too few demonstrations, or a loss that is no number.
    """
    return clone_expert(demonstrations, config or CloningConfig(), np.random.default_rng(seed), progress)[0]


def train(
    config: TrainConfig,
    demonstrations: Demonstrations | None = None,
    expert: Policy | None = None,
    output: str | Path = "out/run",
    stop: Event | None = None,
) -> Policy | None:
    """Learn by a method until the schedule's steps are done.

    Args:
        config: method, task and schedule.
        demonstrations: for methods that need them.
        expert: likewise.
        output: folder of the run; a new one.
        stop: set it to end early.

    Returns:
        The policy of the last step; None for an environment that is not of this project.

    Raises:
        RledError: settings that do not fit each other, or a folder that holds a run.
    """
    directory = RunDirectory(Path(output))
    directory.require_new()
    with composed([config], Inputs(demonstrations, (expert,) if expert else ())) as population:
        directory.create({"config": config.to_dict()})
        learn(population, [directory], stop or Event())
        return population.policy(0)


def evaluate(policy: Policy, demonstrations: Demonstrations, episodes: int = 20, seed: int = 0) -> dict[str, float]:
    """Mean result of whole episodes of the policy's task, begun where the demonstrations begin.

    Returns:
        ``reward`` (1), ``steps``, ``targets_reached`` and ``violations`` of an episode.

    Raises:
        RledError: a robot without a task, or demonstrations of another.
    """
    policy.task.require_same_robot(demonstrations.task, "the demonstrations")
    batch = ReachBatch(policy.task.robot, episodes, reward=policy.task.reward, start_joints=demonstrations.starts)
    return evaluate_policy(policy, batch, seed)
