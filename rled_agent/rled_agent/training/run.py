"""Runs from their settings: what they learn from, what is composed. One run is a population of one."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import torch
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription

from rled_agent.data.demonstration_buffer import DemonstrationBuffer
from rled_agent.data.demonstrations import Demonstrations
from rled_agent.exploration.strategy import PolicyFunction, policy_function
from rled_agent.methods.method import Problem
from rled_agent.nn.draws import Draws
from rled_agent.nn.policy import Origin, Policy
from rled_agent.nn.scaling import Scaling, scaling_of_bounds, scaling_of_points
from rled_agent.per_seed import merged
from rled_agent.replay.replay import Sampler
from rled_agent.training.config import TrainConfig
from rled_agent.training.environment_batch import Environment, EnvironmentBatch, OneByOne
from rled_agent.training.environments import bounds, make_batch, require_robot_of
from rled_agent.training.trainer import Environments, Trainer


class Inputs(NamedTuple):
    """What runs learn from besides experience.

    Attributes:
        demonstrations: of a bag, None without one.
        experts: cloned from them, one for each run; none without.
    """

    demonstrations: Demonstrations | None = None
    experts: tuple[Policy, ...] = ()


class Population(NamedTuple):
    """Runs that were composed to be made together.

    Attributes:
        configs: of each run.
        trainer: the loop's state.
        expert: π̂ᵈ of each run in its units, None without.
        task: of the robot; None for one that is not of this project.
    """

    configs: tuple[TrainConfig, ...]
    trainer: Trainer
    expert: PolicyFunction | None
    task: TaskDescription | None

    def policy(self, run: int) -> Policy | None:
        """What one run has learned, in physical units; None for a robot that is not of this project."""
        if self.task is None:
            return None
        learner, method = self.trainer.learning.learner, self.configs[run].method
        gate = method.gate
        critic = learner.critic.member(run) if gate is not None and gate.estimator == "critics" else None
        return Policy(learner.actor.member(run), self.trainer.scaling, self.task, Origin(method.name, gate), critic)


def require_inputs(config: TrainConfig, inputs: Inputs) -> None:
    """Refuse a method that lacks something.

    Raises:
        RledError: says what.
    """
    given = {"demonstrations": inputs.demonstrations is not None, "expert": bool(inputs.experts)}
    missing = [name for name in config.method.needs if not given[name]]
    if missing:
        what = f"{config.method.name} lacks {' and '.join(missing)}"
        raise RledError(what, "--bag and --expert", "record a bag with record_demos, clone it with train_expert")


@contextlib.contextmanager
def composed(
    configs: Sequence[TrainConfig],
    inputs: Inputs,
    training_env: Callable[[TaskDescription | None], Environment] | None = None,
    device: str = "cpu",
) -> Iterator[Population]:
    """Make environments, learner and strategy of runs; the environments are closed after it.

    Args:
        configs: settings of each run, which differ in the seed and in numbers that may be swept.
        inputs: demonstrations and experts.
        training_env: makes the environment of a single run to act in, for the task that it is looked at in; another
            one of the same kind by default.
        device: that networks, replay and environments are on.

    Raises:
        RledError: settings, bag, weights and environment do not fit each other.
    """
    first, where = configs[0], torch.device(device)
    require_inputs(first, inputs)
    if inputs.demonstrations is not None:
        require_robot_of(inputs.demonstrations.task, first.env, "the bag")
    starts = inputs.demonstrations.starts if inputs.demonstrations is not None else None
    with contextlib.ExitStack() as stack:
        episodes = first.schedule.evaluation_episodes
        evaluation = make_batch(first, starts, len(configs), where, episodes)
        stack.enter_context(contextlib.closing(evaluation))
        if training_env is not None:
            training: EnvironmentBatch = OneByOne([training_env(evaluation.task)], where)
        else:
            training = make_batch(first, starts, len(configs), where)
        stack.enter_context(contextlib.closing(training))
        yield _compose(configs, inputs, training, evaluation, where)


def _compose(
    configs: Sequence[TrainConfig],
    inputs: Inputs,
    training: EnvironmentBatch,
    evaluation: EnvironmentBatch,
    device: torch.device,
) -> Population:
    first, task, seeds = configs[0], evaluation.task, [each.seed for each in configs]
    scaling = _scaling(first, inputs, evaluation)
    experts = inputs.experts if len(inputs.experts) == len(configs) else inputs.experts * len(configs)
    expert = policy_function(experts, scaling, device) if experts else None
    problem = Problem(
        observation_size=len(scaling.observation_scale),
        action_size=len(scaling.action_scale),
        capacity=first.schedule.capacity,
        draws=Draws(seeds, device),
        expert=expert,
        demonstrations=_demonstrated(inputs, task, scaling, seeds, device),
    )
    method = merged([each.method for each in configs], device)
    learning = method.learning(problem)
    strategy = method.strategy(problem, learning.learner)
    environments = Environments(training, evaluation, scaling)
    trainer = Trainer(environments, learning, strategy, first.schedule, has_expert=expert is not None)
    return Population(tuple(configs), trainer, expert, task)


def _scaling(config: TrainConfig, inputs: Inputs, env: EnvironmentBatch) -> Scaling:
    """Of the demonstrations, or of the environment's bounds where there are none."""
    task = env.task
    if task is None and inputs != Inputs():
        raise RledError(
            f"env '{config.env}' has no robot that a bag or an expert could be of", "an environment of rled"
        )
    for given, whose in ((inputs.demonstrations, "the bag"), *((each, "the expert") for each in inputs.experts)):
        if given is not None and task is not None:
            task.require_same_robot(given.task, whose)
    if inputs.demonstrations is None or task is None:
        return scaling_of_bounds(bounds(env.observation_space), bounds(env.action_space))
    visited = inputs.demonstrations.visited
    return scaling_of_points(task, visited.positions, visited.joints)


def _demonstrated(
    inputs: Inputs, task: TaskDescription | None, scaling: Scaling, seeds: Sequence[int], device: torch.device
) -> Callable[[float], Sampler] | None:
    demonstrations = inputs.demonstrations
    if demonstrations is None or task is None:
        return None
    return lambda gamma: DemonstrationBuffer(demonstrations, task, scaling, gamma, seeds, device)
