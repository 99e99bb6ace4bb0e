"""Command: reinforcement learning from a bag of demonstrations, in process or over the graph."""

import difflib
import inspect
import itertools
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Event
from typing import Annotated, Any, Literal

import torch
import tyro
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import RledError, command_line
from rled_msgs_py.stopping import stop_requested
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.validation import Range, check_fields

from rled_agent.bounds import MANY, Share
from rled_agent.cli.members import Member, members_of
from rled_agent.cli.presets import PRESETS, Preset, all_presets
from rled_agent.data.corruption import Corruption
from rled_agent.data.demonstrations import Demonstrations
from rled_agent.data.opening import open_demonstrations
from rled_agent.methods import all_methods
from rled_agent.nn.device import require_device
from rled_agent.nn.policy import Policy, load_policy, policy_file
from rled_agent.training.config import TrainConfig
from rled_agent.training.digests import bag_digest, file_digest
from rled_agent.training.environment_batch import Environment
from rled_agent.training.environments import require_robot_of
from rled_agent.training.learning import train
from rled_agent.training.resuming import require_same_run
from rled_agent.training.run import Inputs, Population, composed

PROGRAM = "train_agent"
USAGE = f"""usage: {PROGRAM} NAME [options]     NAME is a preset or a method; its options: {PROGRAM} NAME --help
       {PROGRAM} --list             all presets and methods in a table

Learn from demonstrations and experience; a run is a folder with settings, metrics, checkpoint and policy. For example:
  {PROGRAM} planar_mc_tuned --bag bags/planar_lemniscate --expert out/expert --output out/run
"""


@dataclass(frozen=True)
class Options:
    """Learn from demonstrations and experience; the run is a folder with settings, metrics, checkpoint and policy."""

    config: Annotated[TrainConfig, tyro.conf.arg(name="")]
    """settings of the run"""
    output: Path
    """folder of the run"""
    bag: Path | None = None
    """demonstrations: rosbag2 folder or .mcap file; episodes start where its motions do"""
    expert: Path | None = None
    """weights that train_expert wrote, or their folder; {seed} in it is the seed of a run"""
    seeds: str = ""
    """several runs made together, as 0-7 or 0,2,5: each the same as alone, in a folder of its own, OUTPUT/seed-0"""
    sweep: tuple[str, ...] = ()
    """several values of a number of the method, as phi=0,0.1,0.3: runs for each, in OUTPUT/phi-0.1/seed-0"""
    device: str = "cpu"
    """of networks, replay and environments: cpu, cuda, cuda:1"""
    source: Literal["points", "trajectories"] = "points"
    """points: every pair of marked points, joined in closed form; trajectories: the motions as recorded, by anybody"""
    points: Annotated[int, Range(0, MANY)] = 0
    """points only: take so many of them, evenly spaced in the order of the marks; 0 takes all"""
    min_quality: Share = 0.0
    """trajectories only: leave out episodes with a lower score, 0 to 1, as demos info shows it"""
    corruption: Corruption = field(default_factory=Corruption)
    """points only: make the demonstrations worse on purpose; give the expert that was cloned from as poor ones"""
    over: Literal["process", "graph"] = "process"
    """process: the environment in this process; graph: a running sim_node, in lockstep, over ROS 2 topics"""
    resume: bool = False
    """continue the run in the output folder, bit for bit in simulation; steps may grow, and files may lie elsewhere,
    but what is in them and all other settings stay"""


@command_line
def main() -> None:
    """Run the command."""
    options = _parsed(sys.argv[1:])
    if options is None:
        return
    torch.set_flush_denormal(True)
    check_fields(options)
    require_device(options.device)
    members = members_of(options.config, options.seeds, options.sweep, options.output)
    if options.over == "graph" and len(members) > 1:
        raise RledError(f"{len(members)} runs over one graph", "one", "leave out --seeds and --sweep")
    if options.resume and len(members) > 1:
        members = _converging(members)
    for each in members:
        each.directory.require_resumable() if options.resume else each.directory.require_new()
    bag = Bag(options.bag) if options.bag else None
    if bag is not None:
        require_robot_of(bag.task, options.config.env, f"bag {bag.path}")
    demonstrations, threads = _demonstrations(options), torch.get_num_threads()
    with stop_requested() as stop:
        for group in _groups(options, members):
            torch.set_num_threads(min(len(group), threads))  # a product of one seed is made by one thread
            if not stop.is_set():
                _make(options, group, bag, demonstrations, stop)


def _converging(members: list[Member]) -> list[Member]:
    """Runs of a population that have not ended early."""
    found = [each for each in members if not each.directory.diverged_path.exists()]
    if not found:
        raise RledError(f"all {len(members)} runs have diverged", "", "begin new ones with another --output")
    return found


def _groups(options: Options, members: list[Member]) -> list[list[Member]]:
    """Runs that stand at the same step: those of a population that was killed while it saved may not."""
    if not options.resume:
        return [members]
    steps = {id(each): each.directory.step() for each in members}
    members = sorted(members, key=lambda each: steps[id(each)])
    return [[*group] for _, group in itertools.groupby(members, key=lambda each: steps[id(each)])]


def _make(
    options: Options, members: list[Member], bag: Bag | None, demonstrations: Demonstrations | None, stop: Event
) -> None:
    """Begin runs in their folders, or go on with those there, and learn."""
    configs, directories = [each.config for each in members], [each.directory for each in members]
    inputs = Inputs(demonstrations, _experts(options, members))
    with composed(configs, inputs, _training_env(options), options.device) as population:
        _open(members, options, population, bag)
        train(population, directories, stop)
    print(f"{population.trainer.step:,} of {options.config.schedule.steps:,} steps; {_where(options, members)}")


def _parsed(arguments: list[str]) -> Options | None:
    """The options, or None where only help was asked for.

    Raises:
        RledError: no preset or method of that name.
    """
    presets, name = all_presets(), arguments[0] if arguments else "--help"
    if name == "--list":
        print(_table())
        return None
    if name in ("-h", "--help"):
        print(f"{USAGE}\n{_table()}")
        return None
    if name not in presets:
        near = difflib.get_close_matches(name, presets, cutoff=0.5)
        remedy = f"did you mean {' or '.join(near)}? " if near else ""
        what = (
            f"no preset or method '{name[:80]}'"
            if not name.startswith("-")
            else f"no preset or method is named before {name[:80]}"
        )
        raise RledError(what, ", ".join(presets), f"{remedy}see what they are: {PROGRAM} --list")
    return tyro.cli(
        Options,
        prog=f"{PROGRAM} {name}",
        description=_description(name, presets[name]),
        args=arguments[1:],
        default=Options(presets[name].config, Path("out") / name),
    )


def _description(name: str, preset: Preset) -> str:
    """What a method is, where it comes from and what it needs."""
    method = type(preset.config.method)
    said = inspect.getdoc(method) or ""
    needs = f" Needs: {', '.join(method.needs)}." if method.needs else ""
    is_preset = f"{name}: {preset.summary}.\n\n" if name in PRESETS else ""
    return f"{is_preset}{preset.config.method.name}: {said}\n\n{method.paper}.{needs}"


def _table() -> str:
    """Presets and methods with their papers."""
    presets = [(name, preset.config.method.name, preset.summary) for name, preset in PRESETS.items()]
    known = [
        (name, ", ".join(each.needs) or "-", f"{each.title} ({each.paper})") for name, each in all_methods().items()
    ]
    wide = max(len(row[0]) for row in presets + known) + 2
    next_wide = max(len(row[1]) for row in presets + known) + 2
    lines = [f"{'preset':<{wide}}{'method':<{next_wide}}what it is"]
    lines += [f"{name:<{wide}}{method:<{next_wide}}{summary}" for name, method, summary in presets]
    lines += ["", f"{'method':<{wide}}{'needs':<{next_wide}}what it is"]
    return "\n".join(lines + [f"{name:<{wide}}{needs:<{next_wide}}{title}" for name, needs, title in known])


def _demonstrations(options: Options) -> Demonstrations | None:
    if options.bag is None:
        return None
    return open_demonstrations(
        options.bag, options.source, options.min_quality, print, options.points, options.corruption
    )


def _experts(options: Options, members: list[Member]) -> tuple[Policy, ...]:
    """One for each run, read once where it is the same."""
    template = options.expert
    if template is None:
        return ()
    read = {path: load_policy(path) for path in dict.fromkeys(each.path(template) for each in members)}
    return tuple(read[each.path(template)] for each in members)


def _training_env(options: Options) -> Callable[[TaskDescription | None], Environment] | None:
    """Makes the environment over the graph, where that is asked for."""
    if options.over == "process":
        return None
    from rled_agent.nodes.graph_env import GraphEnv

    def connect(task: TaskDescription | None) -> Environment:
        if task is None:
            raise RledError(f"no simulation on the graph runs env '{options.config.env}'", "an environment of rled")
        env = GraphEnv()
        task.require_same_robot(env.task, "the simulation")
        if env.task.reward != task.reward:
            raise RledError(
                f"the simulation's reward is {env.task.reward}", task.reward, "start sim_node with --reward"
            )
        return env

    return connect


def _open(members: list[Member], options: Options, population: Population, bag: Bag | None) -> None:
    """Begin runs in their folders, or go on with those there."""
    trainer, records = population.trainer, [_record(options, each, bag, population) for each in members]
    if not options.resume:
        for each, record in zip(members, records, strict=True):
            each.directory.create(record)
        print(_said(options, members))
        if population.expert is not None:
            for each, result in zip(members, trainer.evaluate_function(population.expert), strict=True):
                each.directory.write_expert(result)
        return
    for each, record in zip(members, records, strict=True):
        require_same_run(each.directory.config(), record, each.directory.path)
    repeats = trainer.restore([each.directory.load() for each in members])
    runs = f"{len(members)} runs " if len(members) > 1 else ""
    print(f"continuing {runs}at step {trainer.step:,}{'' if repeats else ', with a new episode'}")


def _said(options: Options, members: list[Member]) -> str:
    """What begins, in a line, and what is given in vain."""
    config, needs = options.config, options.config.method.needs
    vain = (
        ""
        if options.expert is None or "expert" in needs
        else "; the expert does not act, it is evaluated for comparison"
    )
    task = f"{config.env}, reward {config.reward}"
    return f"{config.method.name} on {task}, {config.schedule.steps:,} steps; {_where(options, members)}{vain}"


def _where(options: Options, members: list[Member]) -> str:
    runs = "the run is" if len(members) == 1 else f"{len(members)} runs are"
    return f"{runs} in {options.output}"


def _record(options: Options, member: Member, bag: Bag | None, population: Population) -> dict[str, Any]:
    """What decides a run; of files, what they hold."""
    simulated = population.trainer.env.task if options.over == "graph" else None
    expert = member.path(options.expert) if options.expert is not None else None
    demonstrations = {
        "bag": str(options.bag),
        "bag_sha256": bag_digest(bag) if bag is not None else None,
        "expert": str(expert),
        "expert_sha256": file_digest(policy_file(expert)) if expert is not None else None,
        "source": options.source,
        "points": options.points,
        "min_quality": options.min_quality,
        "corruption": asdict(options.corruption),
        "over": options.over,
        "simulation": asdict(simulated) if simulated is not None else None,
    }
    record = {"config": member.config.to_dict(), "demonstrations": demonstrations}
    plain: dict[str, Any] = json.loads(json.dumps(record))
    return plain


if __name__ == "__main__":
    main()
