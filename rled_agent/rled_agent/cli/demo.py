"""Command: the whole way once, with every command printed as a person would type it."""

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import command_line
from rled_msgs_py.files import write_whole
from rled_msgs_py.outputs import require_output
from rled_msgs_py.processes import Children, program


@dataclass(frozen=True)
class Options:
    """Record demonstrations, learn from the bags, drive a robot over topics, and learn on from experience."""

    output: Path = Path("out/demo")
    """folder for everything that is made"""
    points: int = 1572
    """points of the curve that the Panda's operator marks"""
    trajectories: int = 50
    """targets that the operator reaches after that"""
    expert_steps: int = 20_000
    """gradient steps of the Panda's expert"""
    episodes: int = 20
    """episodes that the agent drives"""
    learning_steps: int = 8_000
    """environment steps of MC RLED on the planar robot"""
    seed: int = 0
    """of everything"""
    domain: int = 87
    """ROS_DOMAIN_ID of the demo's graph"""


@command_line
def main() -> None:
    """Run the command."""
    options = tyro.cli(Options, prog="demo")
    require_output(options.output, "summary.json")
    os.environ.update(ROS_DOMAIN_ID=str(options.domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    print(f"$ export ROS_DOMAIN_ID={options.domain} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")
    panda, planar = options.output / "panda", options.output / "planar"
    _title("1. An operator demonstrates on the Panda; what travels on the topics becomes a bag")
    _record("panda", panda, options.points, options)
    _title("2. The expert network learns from the bag alone")
    _clone(panda, options.expert_steps, options)
    _title("3. The agent drives the robot over topics: three processes, three terminals")
    _drive(panda, options)
    _title("4. The planar robot: a demonstration, and its expert")
    _record("planar", planar, 400, options)
    _clone(planar, 4_000, options)
    _title("5. MC RLED learns over the graph: where the actor is unsure, the expert acts")
    _learn(planar, options)
    _title("6. Expert and learned policy side by side, on seen and unseen targets")
    _run("rled_agent", "evaluate_agent", "--bag", planar / "bag", "--expert", planar / "expert/expert.safetensors",
         "--agent", planar / "run/policy.safetensors", "--output", planar / "evaluation")  # fmt: skip
    _report(panda, planar, options.output)


def _record(robot: str, folder: Path, points: int, options: Options) -> None:
    asked = ["--points", points, "--trajectories", options.trajectories, "--seed", options.seed]
    bag = ["--output", folder / "bag", "--overwrite"]
    _run("rled_teleop", "record_demos", *bag, "--operator", "scripted", "--robot", robot, *asked)


def _clone(folder: Path, steps: int, options: Options) -> None:
    _run("rled_agent", "train_expert", "--bag", folder / "bag", "--output", folder / "expert",
         "--steps", steps, "--seed", options.seed)  # fmt: skip


def _drive(folder: Path, options: Options) -> None:
    with Children() as children:
        children.start(_simulation("panda", folder, options))
        watch = _typed("rled_agent", "watch_episodes", "--episodes", options.episodes, "--seed", options.seed,
                       "--output", folder / "drive")  # fmt: skip
        watching = children.start(watch, capture=False)
        children.start(_typed("rled_agent", "agent_node", "--expert", folder / "expert/expert.safetensors"))
        children.wait(watching)


def _learn(folder: Path, options: Options) -> None:
    shutil.rmtree(folder / "run", ignore_errors=True)
    with Children() as children:
        children.start(_simulation("planar", folder, options))
        command = _typed("rled_agent", "train_agent", "planar_mc_tuned", "--over", "graph", "--bag", folder / "bag",
                         "--expert", folder / "expert/expert.safetensors", "--output", folder / "run",
                         "--schedule.steps", options.learning_steps, "--seed", options.seed)  # fmt: skip
        children.wait(children.start(command, capture=False))


def _simulation(robot: str, folder: Path, options: Options) -> list[str]:
    return _typed("rled_sim", "sim_node", "--robot", robot, "--start-points", folder / "bag",
                  "--seed", options.seed + 1)  # fmt: skip


def _report(panda: Path, planar: Path, output: Path) -> None:
    driven = _read(panda / "drive/episodes.json")
    summary = {
        "bag": str(panda / "bag"),
        "bag_messages": Bag(panda / "bag").message_count,
        "expert_val_mse": _read(panda / "expert/summary.json")["expert_val_mse"],
        "targets_reached": driven["targets_reached"],
        "steps": driven["steps"],
        "episodes": driven["episodes"],
        "picture": str(panda / "drive/paths.png"),
        "planar": _read(planar / "evaluation/evaluation.json"),
    }
    write_whole(output / "summary.json", json.dumps(summary, indent=2) + "\n")
    _title("Done")
    for name, value in summary.items():
        if name != "planar":
            print(f"  {name}: {value}")
    print(f"  all figures in {output / 'summary.json'}")


def _read(path: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return values


def _title(text: str) -> None:
    print(f"\n== {text}", flush=True)


def _typed(package: str, name: str, *arguments: object) -> list[str]:
    return [*program(package, name), *map(str, arguments)]


def _run(package: str, name: str, *arguments: object) -> None:
    with Children() as children:
        children.wait(children.start(_typed(package, name, *arguments), capture=False))


if __name__ == "__main__":
    main()
