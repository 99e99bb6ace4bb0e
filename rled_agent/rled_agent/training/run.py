"""One training run from its settings: what it learns from, what is composed, and the loop with its files."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from typing import NamedTuple

import numpy as np
import torch
from rled_msgs_py.errors import RledError
from torch.utils.tensorboard import SummaryWriter

from rled_agent.data.demonstration_buffer import DemonstrationBuffer
from rled_agent.data.demonstrations import Demonstrations
from rled_agent.exploration.strategy import PolicyFunction, policy_function
from rled_agent.methods.method import Problem
from rled_agent.nn.policy import Origin, Policy
from rled_agent.nn.scaling import Scaling, scaling_of_bounds, scaling_of_points
from rled_agent.replay.replay import Sampler
from rled_agent.training.config import TrainConfig
from rled_agent.training.environments import Environment, bounds, make_environment, require_robot_of, task_of
from rled_agent.training.metrics import MetricsAccumulator
from rled_agent.training.progress import Progress
from rled_agent.training.run_directory import RunDirectory
from rled_agent.training.trainer import DivergenceError, Environments, Trainer

SHOWN = {
    "updates_per_second": "updates/s",
    "reward": "return",
    "targets_reached": "targets",
    "demonstrated_share": "demonstrated",
    "qcd_median": "uncertainty",
}
"""Metrics beside the bar, where there are any."""


class Inputs(NamedTuple):
    """What a run learns from besides experience.

    Attributes:
        demonstrations: of a bag, None without one.
        expert: cloned from them, None without one.
    """

    demonstrations: Demonstrations | None = None
    expert: Policy | None = None


class Run(NamedTuple):
    """A run that was composed.

    Attributes:
        config: its settings.
        trainer: the loop's state.
        expert: π̂ᵈ in the run's units, None without one.
    """

    config: TrainConfig
    trainer: Trainer
    expert: PolicyFunction | None

    def policy(self) -> Policy | None:
        """What was learned, in physical units; None for a robot that is not of this project."""
        trainer, method = self.trainer, self.config.method
        task = task_of(trainer.evaluation_env)
        if task is None:
            return None
        learner, gate = trainer.learning.learner, method.gate
        critic = learner.critic if gate is not None and gate.estimator == "critics" else None
        return Policy(learner.actor, trainer.scaling, task, Origin(method.name, gate), critic)


def require_inputs(config: TrainConfig, inputs: Inputs) -> None:
    """Refuse a method that lacks something.

    Raises:
        RledError: says what.
    """
    missing = [name for name in config.method.needs if getattr(inputs, name) is None]
    if missing:
        what = f"{config.method.name} lacks {' and '.join(missing)}"
        raise RledError(what, "--bag and --expert", "record a bag with record_demos, clone it with train_expert")


@contextlib.contextmanager
def composed(
    config: TrainConfig, inputs: Inputs, training_env: Callable[[Environment], Environment] | None = None
) -> Iterator[Run]:
    """Make environments, learner and strategy of a run; the environments are closed after it.

    Args:
        config: settings.
        inputs: demonstrations and expert.
        training_env: makes the environment to act in, from the one that it is looked at in; another one of the same
            kind by default.

    Raises:
        RledError: settings, bag, weights and environment do not fit each other.
    """
    require_inputs(config, inputs)
    if inputs.demonstrations is not None:
        require_robot_of(inputs.demonstrations.task, config.env, "the bag")
    starts = inputs.demonstrations.starts if inputs.demonstrations is not None else None
    with contextlib.ExitStack() as stack:
        evaluation_env = stack.enter_context(contextlib.closing(make_environment(config, starts)))
        env = training_env(evaluation_env) if training_env is not None else make_environment(config, starts)
        stack.enter_context(contextlib.closing(env))
        yield _compose(config, inputs, env, evaluation_env)


def _compose(config: TrainConfig, inputs: Inputs, env: Environment, evaluation_env: Environment) -> Run:
    scaling = _scaling(config, inputs, evaluation_env)
    expert = policy_function(inputs.expert, scaling) if inputs.expert is not None else None
    generator = np.random.default_rng(config.seed)
    problem = Problem(
        observation_size=len(scaling.observation_scale),
        action_size=len(scaling.action_scale),
        capacity=config.schedule.capacity,
        generator=generator,
        torch_generator=torch.Generator().manual_seed(int(generator.integers(2**63))),
        expert=expert,
        demonstrations=_demonstrated(inputs, evaluation_env, scaling, generator),
    )
    learning = config.method.learning(problem)
    strategy = config.method.strategy(problem, learning.learner)
    environments = Environments(env, evaluation_env, scaling)
    trainer = Trainer(environments, learning, strategy, config.schedule, generator, has_expert=expert is not None)
    return Run(config, trainer, expert)


def _scaling(config: TrainConfig, inputs: Inputs, env: Environment) -> Scaling:
    """Of the demonstrations, or of the environment's bounds where there are none."""
    task = task_of(env)
    if task is None and inputs != Inputs():
        raise RledError(
            f"env '{config.env}' has no robot that a bag or an expert could be of", "an environment of rled"
        )
    for given, whose in ((inputs.demonstrations, "the bag"), (inputs.expert, "the expert")):
        if given is not None and task is not None:
            task.require_same_robot(given.task, whose)
    if inputs.demonstrations is None or task is None:
        return scaling_of_bounds(bounds(env.observation_space), bounds(env.action_space))
    visited = inputs.demonstrations.visited
    return scaling_of_points(task, visited.positions, visited.joints)


def _demonstrated(
    inputs: Inputs, env: Environment, scaling: Scaling, generator: np.random.Generator
) -> Callable[[float], Sampler] | None:
    demonstrations, task = inputs.demonstrations, task_of(env)
    if demonstrations is None or task is None:
        return None
    return lambda gamma: DemonstrationBuffer(demonstrations, task, scaling, gamma, generator)


class _Begin(NamedTuple):
    """Where a run was when this process took it up.

    Attributes:
        time: of the performance counter (s).
        step: environment steps.
        updates: gradient steps.
    """

    time: float
    step: int
    updates: int


def train(run: Run, directory: RunDirectory, stop: Event) -> None:
    """Learn until the schedule's steps are done or ``stop`` is set; the last state is saved.

    Raises:
        DivergenceError: a loss is no number.
    """
    trainer, schedule = run.trainer, run.config.schedule
    begin = _Begin(time.perf_counter(), trainer.step, trainer.learning.learner.updates)
    with (
        SummaryWriter(str(directory.path), purge_step=trainer.step) as board,
        Progress("step", schedule.steps, trainer.step) as progress,
    ):
        while trainer.step < schedule.steps and not stop.is_set():
            _advance(trainer, directory)
            progress.move(trainer.step)
            if trainer.step % schedule.log_every == 0 or trainer.step == schedule.steps:
                row = _row(trainer, begin)
                directory.append(row)
                if directory.ends_in_the_best():
                    _save_policy(run, directory.best_path)
                _show(row, progress, board)
            if trainer.step % schedule.checkpoint_every == 0 or trainer.step == schedule.steps:
                _save(run, directory)
    if stop.is_set():
        _save(run, directory)


def _advance(trainer: Trainer, directory: RunDirectory) -> None:
    try:
        trainer.advance()
    except DivergenceError as error:
        last = f"the last good checkpoint is {directory.checkpoint_path}"
        kept = last if directory.checkpoint_path.exists() else "there is no checkpoint yet"
        raise DivergenceError(error.what, error.accepted, f"{error.remedy}; {kept}") from None


def _row(trainer: Trainer, begin: _Begin) -> dict[str, float]:
    """Close the interval; evaluate when it is due."""
    seconds, updates = time.perf_counter() - begin.time, trainer.learning.learner.updates
    row = {"step": float(trainer.step), **trainer.metrics.row(trainer.has_expert), "updates": float(updates)}
    row["steps_per_second"] = (trainer.step - begin.step) / seconds
    row["updates_per_second"] = (updates - begin.updates) / seconds
    trainer.metrics = MetricsAccumulator()
    due = trainer.step % trainer.schedule.evaluate_every == 0
    return row | ({f"evaluation_{name}": value for name, value in trainer.evaluate().items()} if due else {})


def _show(row: dict[str, float], progress: Progress, board: SummaryWriter) -> None:
    for name, value in row.items():
        if np.isfinite(value):
            board.add_scalar(name, value, int(row["step"]))
    progress.say(int(row["step"]), {said: row[name] for name, said in SHOWN.items() if name in row})


def _save(run: Run, directory: RunDirectory) -> None:
    directory.save(run.trainer.checkpoint())
    _save_policy(run, directory.policy_path)


def _save_policy(run: Run, path: Path) -> None:
    policy = run.policy()
    if policy is not None:
        policy.save(path)
