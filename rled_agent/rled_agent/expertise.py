"""What a run knows of the expert: the cloned policy and ζᵇ, in the units that the run's networks see."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import RledError

from rled_agent.behaviour import Source, policy_source
from rled_agent.config import TrainConfig
from rled_agent.demonstrations import joined_points
from rled_agent.environments import Environment, bounds, task_of
from rled_agent.expert_rows import ExpertRows
from rled_agent.flaws import NO_FLAWS, Flaws
from rled_agent.nn.scaling import Scaling, scaling_of_bounds, scaling_of_points
from rled_agent.policy import load_policy


class Expertise(NamedTuple):
    """The expert of a run.

    Attributes:
        source: π̂ᵈ, None without demonstrations.
        rows: draws demonstrated transitions, None without demonstrations.
        scaling: of observations and actions.
    """

    source: Source | None
    rows: ExpertRows | None
    scaling: Scaling


def no_expertise(env: Environment, config: TrainConfig) -> Expertise:
    """Without demonstrations: the scaling of the environment's bounds.

    Raises:
        RledError: the settings ask for an expert.
    """
    schedule = config.schedule
    alone = config.behaviour.name == "biased" and not config.behaviour.phi and not config.learner.expert_bootstrap
    if not alone or schedule.expert_share or schedule.preload:
        raise RledError("these settings need an expert", "--bag and --expert", "or --behaviour.phi 0")
    scaling = scaling_of_bounds(bounds(env.observation_space), bounds(env.action_space))
    return Expertise(None, None, scaling)


def read_expertise(
    env: Environment, bag: Bag, expert: Path, config: TrainConfig, points: int = 0, flaws: Flaws = NO_FLAWS
) -> Expertise:
    """The expert of a bag, or of so many of its marked points, and a weights file.

    Args:
        env: the environment to learn in.
        bag: the demonstrations.
        expert: weights that were cloned from them.
        config: settings of the run.
        points: how many marked points are taken; 0 for all.
        flaws: how poor the demonstrations are made.

    Raises:
        RledError: bag, weights and environment are not of one robot and task.
    """
    task = task_of(env)
    if task is None:
        raise RledError(f"env '{config.env}' has no robot that a bag could be of", "an environment of rled")
    policy = load_policy(expert)
    task.require_same_robot(bag.task, "the bag")
    task.require_same_robot(policy.task, "the expert")
    demonstrations = replace(joined_points(bag, points, flaws), task=task)
    scaling = scaling_of_points(task, demonstrations.points.positions, demonstrations.points.joints)
    rows = ExpertRows(demonstrations, scaling)
    return Expertise(policy_source(policy, scaling), rows, scaling)
