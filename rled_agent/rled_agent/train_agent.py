"""Command: reinforcement learning from a bag of demonstrations, in process or over the graph."""

import contextlib
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Event
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import RledError, command_line
from rled_msgs_py.stopping import stop_requested
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.validation import Range, check_fields
from torch.utils.tensorboard import SummaryWriter

from rled_agent.bounds import MANY
from rled_agent.config import TrainConfig
from rled_agent.demonstrations import demonstration_points
from rled_agent.digests import bag_digest, file_digest
from rled_agent.environments import Environment, make_environment, require_robot_of, task_of
from rled_agent.expertise import Expertise, no_expertise, read_expertise
from rled_agent.flaws import Flaws
from rled_agent.interval import Interval
from rled_agent.policy import Policy
from rled_agent.presets import PRESETS
from rled_agent.progress import Progress
from rled_agent.resuming import require_same_run
from rled_agent.rollout import EpisodeResult
from rled_agent.run_directory import RunDirectory
from rled_agent.trainer import DivergenceError, Trainer


@dataclass(frozen=True)
class Options:
    """Learn from demonstrations and experience; the run is a folder with settings, metrics, checkpoint and policy."""

    output: Path
    """folder of the run"""
    bag: Path | None = None
    """demonstrations: rosbag2 folder or .mcap file; its marked points are where episodes start"""
    expert: Path | None = None
    """weights that train_expert wrote"""
    points: Annotated[int, Range(0, MANY)] = 0
    """take only so many of the marked points, evenly spaced in the order of the marks; 0 takes all"""
    flaws: Flaws = field(default_factory=Flaws)
    """make the demonstrations worse on purpose; give the expert that was cloned from as poor ones"""
    over: Literal["process", "graph"] = "process"
    """process: the environment in this process; graph: a running sim_node, in lockstep, over ROS 2 topics"""
    resume: bool = False
    """continue the run in the output folder, bit for bit; steps may grow, and files may lie elsewhere, but what is in
    them and all other settings stay"""
    config: Annotated[TrainConfig, tyro.conf.arg(name="")] = field(default_factory=TrainConfig)
    """settings of the run"""


class Begin(NamedTuple):
    """Where a run was when this process took it up.

    Attributes:
        time: of the performance counter (s).
        step: environment steps.
        updates: gradient steps.
    """

    time: float
    step: int
    updates: int


@command_line
def main() -> None:
    """Run the command."""
    presets = {
        name: (summary, Options(Path("out") / name, config=config)) for name, (summary, config) in PRESETS.items()
    }
    options = tyro.extras.overridable_config_cli(presets, prog="train_agent")
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    check_fields(options)
    directory = RunDirectory(options.output)
    if options.resume:
        directory.require_resumable()
    else:
        directory.require_new()
    bag = Bag(options.bag) if options.bag else None
    with _environments(options, bag) as (env, evaluation_env, expertise):
        trainer = Trainer(env, evaluation_env, options.config, expertise)
        _open_run(directory, options, trainer, bag)
        with stop_requested() as stop, SummaryWriter(str(options.output), purge_step=trainer.step) as board:
            _train(trainer, directory, board, stop)
    print(f"{trainer.step:,} of {options.config.schedule.steps:,} steps; the run is in {options.output}")


def _record(options: Options, bag: Bag | None, env: Environment) -> dict[str, Any]:
    """What decides the run; of files, what they hold."""
    simulated = task_of(env) if options.over == "graph" else None
    demonstrations = {
        "bag": str(options.bag),
        "bag_sha256": bag_digest(bag) if bag is not None else None,
        "expert": str(options.expert),
        "expert_sha256": file_digest(options.expert) if options.expert is not None else None,
        "points": options.points,
        "flaws": asdict(options.flaws),
        "over": options.over,
        "simulation": asdict(simulated) if simulated is not None else None,
    }
    plain: dict[str, Any] = json.loads(
        json.dumps({"config": options.config.to_dict(), "demonstrations": demonstrations})
    )
    return plain


def _open_run(directory: RunDirectory, options: Options, trainer: Trainer, bag: Bag | None) -> None:
    record = _record(options, bag, trainer.env)
    if not options.resume:
        directory.create(record)
        if trainer.expertise.source is not None:
            directory.write_expert(trainer.evaluate_source(trainer.expertise.source))
        return
    require_same_run(directory.config(), record, options.output)
    trainer.restore(directory.load())
    print(f"continuing at step {trainer.step:,}")


@contextlib.contextmanager
def _environments(options: Options, bag: Bag | None) -> Iterator[tuple[Environment, Environment, Expertise]]:
    if bag is not None:
        require_robot_of(bag, options.config.env)
    starts: NDArray[np.float64] | None = demonstration_points(bag, options.points).joints if bag else None
    evaluation_env = make_environment(options.config, starts)
    if bag is not None and options.expert is not None:
        expertise = read_expertise(evaluation_env, bag, options.expert, options.config, options.points, options.flaws)
    else:
        expertise = no_expertise(evaluation_env, options.config)
    env = _training_environment(options, starts, task_of(evaluation_env))
    try:
        yield env, evaluation_env, expertise
    finally:
        env.close()
        evaluation_env.close()


def _training_environment(
    options: Options, starts: NDArray[np.float64] | None, task: TaskDescription | None
) -> Environment:
    if options.over == "process":
        return make_environment(options.config, starts)
    from rled_agent.graph_env import GraphEnv

    if task is None:
        raise RledError(f"no simulation on the graph runs env '{options.config.env}'", "an environment of rled")
    env = GraphEnv()
    task.require_same_robot(env.task, "the simulation")
    if env.task.reward != task.reward:
        raise RledError(f"the simulation's reward is {env.task.reward}", task.reward, "start sim_node with --reward")
    return env


def _train(trainer: Trainer, directory: RunDirectory, board: SummaryWriter, stop: Event) -> None:
    schedule = trainer.config.schedule
    begin = Begin(time.perf_counter(), trainer.step, trainer.learner.updates)
    with Progress("step", schedule.steps, trainer.step) as progress:
        while trainer.step < schedule.steps and not stop.is_set():
            _advance(trainer, directory)
            progress.move(trainer.step)
            if trainer.step % schedule.log_every == 0 or trainer.step == schedule.steps:
                row = _row(trainer, begin)
                directory.append(row)
                if directory.ends_in_the_best():
                    _save_policy(trainer, directory.best_path)
                _show(row, progress, board)
            if trainer.step % schedule.checkpoint_every == 0 or trainer.step == schedule.steps:
                _save(trainer, directory)
    if stop.is_set():
        _save(trainer, directory)


def _advance(trainer: Trainer, directory: RunDirectory) -> None:
    try:
        trainer.advance()
    except DivergenceError as error:
        last = f"the last good checkpoint is {directory.checkpoint_path}"
        kept = last if directory.checkpoint_path.exists() else "there is no checkpoint yet"
        raise DivergenceError(error.what, error.accepted, f"{error.remedy}; {kept}") from None


def _row(trainer: Trainer, begin: Begin) -> dict[str, float]:
    """Close the interval; evaluate when it is due."""
    seconds = time.perf_counter() - begin.time
    row = {"step": float(trainer.step), **trainer.interval.row(), "updates": float(trainer.learner.updates)}
    row["steps_per_second"] = (trainer.step - begin.step) / seconds
    row["updates_per_second"] = (trainer.learner.updates - begin.updates) / seconds
    trainer.interval = Interval()
    due = trainer.step % trainer.config.schedule.evaluate_every == 0
    results = trainer.evaluate() if due else dict.fromkeys(EpisodeResult._fields, np.nan)
    return row | {f"evaluation_{name}": value for name, value in results.items()}


def _show(row: dict[str, float], progress: Progress, board: SummaryWriter) -> None:
    for name, value in row.items():
        if np.isfinite(value):
            board.add_scalar(name, value, int(row["step"]))
    shown = {
        "updates/s": row["updates_per_second"],
        "return": row["reward"],
        "targets": row["targets_reached"],
        "demonstrated": row["demonstrated_share"],
        "uncertainty": row["qcd_median"],
    }
    progress.say(int(row["step"]), shown)


def _save(trainer: Trainer, directory: RunDirectory) -> None:
    directory.save(trainer.checkpoint())
    _save_policy(trainer, directory.policy_path)


def _save_policy(trainer: Trainer, path: Path) -> None:
    task = task_of(trainer.evaluation_env)
    if task is not None:
        Policy(trainer.learner.actor, trainer.expertise.scaling, task, trainer.config.behaviour.gate).save(path)


if __name__ == "__main__":
    main()
