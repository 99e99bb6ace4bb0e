"""Command: the whole way once, with every command printed as a person would type it."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import command_line
from rled_msgs_py.files import write_whole
from rled_msgs_py.processes import Children, program


@dataclass(frozen=True)
class Options:
    """Record a demonstration, learn it from the bag, drive the robot over topics."""

    output: Path = Path("out/demo")
    """folder for everything that is made"""
    points: int = 1572
    """points of the curve that the operator marks"""
    trajectories: int = 50
    """targets that the operator reaches after that"""
    steps: int = 20_000
    """gradient steps of the expert"""
    episodes: int = 20
    """episodes that the agent drives"""
    seed: int = 0
    """of everything"""
    domain: int = 87
    """ROS_DOMAIN_ID of the demo's graph"""


@command_line
def main() -> None:
    """Run the command."""
    options = tyro.cli(Options, prog="demo")
    os.environ.update(ROS_DOMAIN_ID=str(options.domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    print(f"$ export ROS_DOMAIN_ID={options.domain} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")
    bag, expert, drive = (options.output / name for name in ("bag", "expert", "drive"))
    _title("1. An operator demonstrates; what travels on the topics becomes a bag")
    _run("rled_teleop", "record_demos", "--output", bag, "--overwrite", "--operator", "scripted", "--robot", "panda",
         "--points", options.points, "--trajectories", options.trajectories, "--seed", options.seed)  # fmt: skip
    _title("2. The expert network learns from the bag alone")
    _run("rled_agent", "train_expert", "--bag", bag, "--output", expert, "--steps", options.steps,
         "--seed", options.seed)  # fmt: skip
    _title("3. The agent drives the robot over topics: three processes, three terminals")
    _drive(bag, expert / "expert.safetensors", drive, options)
    _report(options.output, bag, expert, drive)


def _drive(bag: Path, weights: Path, drive: Path, options: Options) -> None:
    with Children() as children:
        children.start(_typed("rled_sim", "sim_node", "--robot", "panda", "--start-points", bag,
                              "--seed", options.seed + 1))  # fmt: skip
        watch = children.start(
            _typed("rled_agent", "watch_episodes", "--episodes", options.episodes, "--output", drive), capture=False
        )
        children.start(_typed("rled_agent", "agent_node", "--expert", weights))
        children.wait(watch)


def _report(output: Path, bag: Path, expert: Path, drive: Path) -> None:
    driven = _read(drive / "episodes.json")
    summary = {
        "bag": str(bag),
        "bag_messages": Bag(bag).message_count,
        "expert_val_mse": _read(expert / "summary.json")["expert_val_mse"],
        "targets_reached": driven["targets_reached"],
        "steps": driven["steps"],
        "episodes": driven["episodes"],
        "path_picture": str(drive / "paths.png"),
    }
    write_whole(output / "summary.json", json.dumps(summary, indent=2) + "\n")
    _title("Done")
    for name, value in summary.items():
        print(f"  {name}: {value}")
    print(f"  written to {output / 'summary.json'}")


def _read(path: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads(path.read_text())
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
