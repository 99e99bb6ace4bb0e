"""Command: expert and learned policy side by side, on seen and unseen targets."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import RledError, command_line
from rled_msgs_py.files import write_whole
from rled_msgs_py.outputs import require_output
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.validation import Range, check_fields
from rled_sim.faults import Faults
from rled_sim.kinematics import Chain
from rled_sim.robots import robot_named
from rled_sim.tasks import reach_task
from rled_sim.vector.reach import ReachBatch

from rled_agent.bounds import Count, Seed
from rled_agent.data.closed_form import demonstration_points
from rled_agent.data.demonstrations import DemonstrationPoints
from rled_agent.nn.policy import Policy, load_policy
from rled_agent.training.evaluating import evaluate_policy
from rled_agent.training.evaluation import (
    DistanceBin,
    Score,
    Trace,
    Trajectory,
    move,
    score,
    seen_bin,
    trace,
    unseen_bin,
)
from rled_agent.training.plots import Floats, draw_tool_paths, drawn_plane
from rled_agent.training.progress import Progress

DRAWN_TRAJECTORIES = 20
"""Motions of a distance bin that are drawn and kept."""


@dataclass(frozen=True)
class Options:
    """Compare policies on demonstrated targets and on others ever farther away.

    Writes evaluation.json, motions.json and a picture of the paths in each bin into the output folder, and prints a
    table; with episodes, episodes.json and a second table.
    """

    bag: Path
    """demonstrations whose marked points are the seen targets"""
    expert: Path
    """weights that train_expert wrote"""
    agent: Path | None = None
    """policy that train_agent wrote, to stand beside the expert"""
    output: Path = Path("out/evaluation")
    """folder for the results"""
    bins: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2)
    """bounds between the bins of unseen targets: distance from the nearest demonstrated point (m)"""
    targets: Annotated[int, Range(1, 100_000)] = 100
    """targets in a distance bin"""
    steps: Count = 200
    """most steps to a target"""
    episodes: Annotated[int, Range(0, 100_000)] = 0
    """whole episodes of the task to drive besides, from the marked points, behind the faults"""
    faults: Faults = field(default_factory=Faults)
    """on purpose, in the episodes"""
    seed: Seed = 0
    """of targets, starts and faults"""


@command_line
def main() -> None:
    """Run the command."""
    options = tyro.cli(Options, prog="evaluate_agent")
    check_fields(options)
    require_output(options.output, "evaluation.json", "motions.json", "episodes.json")
    torch.set_num_threads(1)
    if list(options.bins) != sorted(set(options.bins)) or len(options.bins) < 2:
        raise RledError(f"bins {options.bins}", "two or more growing distances in metres")
    if options.faults.any and not options.episodes:
        raise RledError("there are faults, and no episodes to have them in", "", "give --episodes 20")
    bag = Bag(options.bag)
    policies = {"expert": load_policy(options.expert)}
    if options.agent is not None:
        policies["agent"] = load_policy(options.agent)
    for name, policy in policies.items():
        bag.task.require_same_robot(policy.task, name)
        if policy.origin.gate is not None:
            print(f"{name}: learned behind the gate ({policy.origin.gate}); here it acts alone")
    points = demonstration_points(bag)
    episodes = _drive(bag.task.robot, points, policies, options) if options.episodes else {}
    results, motions = _evaluate(bag, points, policies, options)
    _print_table(results)
    if episodes:
        _print_episodes(episodes)
        write_whole(options.output / "episodes.json", json.dumps(episodes, indent=2) + "\n")
    write_whole(options.output / "motions.json", json.dumps(motions) + "\n")
    plain = {group: {name: _plain(value) for name, value in row.items()} for group, row in results.items()}
    write_whole(options.output / "evaluation.json", json.dumps(plain, indent=2) + "\n")
    print(f"wrote {options.output}")


def _evaluate(
    bag: Bag, points: DemonstrationPoints, policies: Mapping[str, Policy], options: Options
) -> tuple[dict[str, dict[str, Score]], dict[str, dict[str, list[Trace]]]]:
    """Scores of each policy in each distance bin, and the trace of the motions that are drawn."""
    task = bag.task
    chain = Chain.from_urdf(bag.robot_description, task.tip_link, task.joint_names)
    risky = reach_task(robot_named(task.robot)).risky
    results: dict[str, dict[str, Score]] = {}
    traces: dict[str, dict[str, list[Trace]]] = {}
    bins = _bins(bag.task, points, chain, options)
    with Progress("bin", len(bins)) as progress:
        for done, group in enumerate(bins, start=1):
            motions = {name: move(task, chain, policy.act, group, options.steps) for name, policy in policies.items()}
            row = {name: score(task, each, risky) for name, each in motions.items()}
            _draw(options.output / f"paths_{group.name.replace(' ', '_')}.png", group, points.positions, motions, task)
            progress.say(done, {f"success of {name}": each.success for name, each in row.items()})
            results[group.name] = row
            traces[group.name] = {
                name: [trace(motion) for motion in each[:DRAWN_TRAJECTORIES]] for name, each in motions.items()
            }
    return results, traces


def _drive(
    robot: str, points: DemonstrationPoints, policies: Mapping[str, Policy], options: Options
) -> dict[str, dict[str, float]]:
    """Mean result of each policy in the same whole episodes."""
    batch = ReachBatch(robot, options.episodes, reward="dense", start_joints=points.joints, faults=options.faults)
    results: dict[str, dict[str, float]] = {}
    with Progress("policy", len(policies)) as progress:
        for done, (name, policy) in enumerate(policies.items(), start=1):
            results[name] = evaluate_policy(policy, batch, options.seed)
            progress.say(done, {"targets": results[name]["targets_reached"]})
    return results


def _bins(task: TaskDescription, points: DemonstrationPoints, chain: Chain, options: Options) -> list[DistanceBin]:
    generator = np.random.default_rng(options.seed)
    bounds = list(zip(options.bins, options.bins[1:], strict=False))
    unseen = [unseen_bin(task, chain, points, each, options.targets, generator) for each in bounds]
    return [seen_bin(points, options.targets, generator), *unseen]


def _draw(
    path: Path, group: DistanceBin, known: Floats, motions: Mapping[str, list[Trajectory]], task: TaskDescription
) -> None:
    paths = {name: [motion.positions for motion in each[:DRAWN_TRAJECTORIES]] for name, each in motions.items()}
    plane = drawn_plane(task)
    title = f"{task.robot}: targets {group.name}, {len(group.targets[:DRAWN_TRAJECTORIES])} of {len(group.targets)}"
    goals = group.targets[:DRAWN_TRAJECTORIES]
    draw_tool_paths(path, ("demonstrated points", known), goals, paths, plane, task.tolerance**0.5, title)


def _plain(value: Score) -> dict[str, float | None]:
    return {name: metric if math.isfinite(metric) else None for name, metric in value._asdict().items()}


def _print_table(results: Mapping[str, Mapping[str, Score]]) -> None:
    heads = ("success", "steps", "path/straight", "jerk m/s3", "violations")
    print(f"{'targets':<16}{'policy':<8}" + "".join(f"{head:>14}" for head in heads))
    for group, row in results.items():
        for name, value in row.items():
            print(f"{group:<16}{name:<8}" + "".join(f"{metric:>14.3g}" for metric in value))


def _print_episodes(episodes: Mapping[str, Mapping[str, float]]) -> None:
    heads = ("return", "steps", "targets", "violations")
    print(f"\n{'episodes':<24}" + "".join(f"{head:>14}" for head in heads))
    for name, row in episodes.items():
        print(f"{name:<24}" + "".join(f"{metric:>14.4g}" for metric in row.values()))


if __name__ == "__main__":
    main()
