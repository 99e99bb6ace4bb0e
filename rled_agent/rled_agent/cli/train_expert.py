"""Command: learn the expert policy from a bag of demonstrations (behavioural cloning, Eq. 4.10)."""

import csv
import io
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import torch
import tyro
from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import RledError, command_line
from rled_msgs_py.files import write_whole
from rled_msgs_py.outputs import require_output
from rled_msgs_py.validation import Range, check_fields

from rled_agent.bounds import MANY, Seed, Share
from rled_agent.data.corruption import Corruption
from rled_agent.data.opening import open_demonstrations
from rled_agent.learners.cloning import CloningConfig, CurvePoint, clone_expert
from rled_agent.training.digests import bag_digest
from rled_agent.training.plots import draw_learning_curve
from rled_agent.training.progress import Progress

FILES = ("expert.safetensors", "curve.csv", "learning_curve.png", "summary.json")


@dataclass(frozen=True)
class Options:
    """Learn the expert policy from a bag of demonstrations.

    Writes expert.safetensors, curve.csv, learning_curve.png and summary.json into the output folder.
    """

    bag: Path | None = None
    """rosbag2 folder or .mcap file"""
    live: bool = False
    """learn from a demonstration on the topics instead, played back or made now; it is kept in OUTPUT/demonstrations"""
    output: Path = Path("out/expert")
    """folder for the results"""
    source: Literal["points", "trajectories"] = "points"
    """points: every pair of marked points, joined in closed form; trajectories: the motions as recorded"""
    points: Annotated[int, Range(0, MANY)] = 0
    """points only: take so many of them, evenly spaced in the order of the marks; 0 takes all"""
    corruption: Corruption = field(default_factory=Corruption)
    """points only: make the demonstrations worse on purpose"""
    min_quality: Share = 0.0
    """trajectories only: leave out episodes with a lower score, 0 to 1, as demos info shows it"""
    seed: Seed = 0
    """of weights, split and batches: the same seed gives the same weights"""
    expert: Annotated[CloningConfig, tyro.conf.arg(name="")] = field(default_factory=CloningConfig)
    """network and training"""


@command_line
def main() -> None:
    """Run the command."""
    options = tyro.cli(Options, prog="train_expert")
    check_fields(options)
    require_output(options.output, *FILES)
    torch.set_num_threads(1)
    bag = _bag(options)
    demonstrations = open_demonstrations(
        bag, options.source, options.min_quality, print, options.points, options.corruption
    )
    print(f"{len(demonstrations):,} demonstrated transitions of robot {demonstrations.task.robot}")
    generator = np.random.default_rng(options.seed)
    with Progress("step", options.expert.steps) as progress:

        def report(point: CurvePoint) -> None:
            progress.say(point.step, {"training error": point.train, "validation error": point.validation})

        policy, curve = clone_expert(demonstrations, options.expert, generator, report)
    policy.save(options.output / "expert.safetensors")
    _write_curve(options.output, curve)
    summary = {
        "bag": str(bag),
        "bag_sha256": bag_digest(Bag(bag)),
        "source": options.source,
        "points": options.points,
        "corruption": asdict(options.corruption),
        "min_quality": options.min_quality,
        "transitions": len(demonstrations),
        "expert_val_mse": curve[-1].validation,
        "seed": options.seed,
        "config": asdict(options.expert),
    }
    write_whole(options.output / "summary.json", json.dumps(summary, indent=2) + "\n")
    print(f"validation error {curve[-1].validation:.5f}; wrote {options.output / 'expert.safetensors'}")


def _bag(options: Options) -> Path:
    """The bag to learn from; a live demonstration becomes one.

    Raises:
        RledError: neither or both are asked for, or nothing was demonstrated.
    """
    if options.live == (options.bag is not None):
        raise RledError("no demonstration is named" if options.bag is None else "both --bag and --live", "one of them")
    if options.bag is not None:
        return options.bag
    from rled_agent.nodes.live_demonstrations import receive_demonstrations  # the one part that needs ROS

    bag = options.output / "demonstrations"
    print(f"{receive_demonstrations(bag):,} messages received; kept in {bag}")
    return bag


def _write_curve(folder: Path, curve: list[CurvePoint]) -> None:
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(CurvePoint._fields)
    writer.writerows(curve)
    write_whole(folder / "curve.csv", text.getvalue())
    draw_learning_curve(folder / "learning_curve.png", curve)


if __name__ == "__main__":
    main()
