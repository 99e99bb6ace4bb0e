"""``demos plot``: paths of the end effector and joint curves as PNG."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from rled_msgs_py.bags import Bag, Review, review
from rled_msgs_py.bags.series import Floats
from rled_msgs_py.errors import RledError
from rled_msgs_py.outputs import require_output
from rled_msgs_py.pictures import picture
from rled_msgs_py.task import TaskDescription

AXES = "xyz"


@dataclass(frozen=True)
class Plot:
    """Draw the paths of a bag's episodes, coloured by quality, and its joint angles over time."""

    bag: tyro.conf.Positional[Path]
    """rosbag2 folder, .mcap or .db3 file"""
    output: Path = Path("out/plots")
    """folder for paths.png and joints.png"""

    def run(self) -> int:
        """Draw; returns the exit code."""
        require_output(self.output, "paths.png", "joints.png")
        bag = Bag(self.bag)
        found = review(bag)
        if not len(found.line.moments):
            raise RledError(f"{self.bag} has no ticks to draw", "a bag with states")
        draw_paths(self.output / "paths.png", found, bag.task)
        draw_joints(self.output / "joints.png", found, bag.task)
        print(f"wrote {self.output / 'paths.png'} and {self.output / 'joints.png'}")
        return 0


def draw_paths(path: Path, found: Review, task: TaskDescription) -> None:
    """Paths of the end effector, seen along the axis of the least extent; green is good, red is poor."""
    left, right = widest_plane(found.line.position)
    with picture(path, 7.5, 6.0) as axes:
        for episode, quality in zip(found.episodes, found.qualities, strict=True):
            color = (1.0 - quality.score, 0.75 * quality.score, 0.1, 0.6)
            for leg in episode.legs:
                way = found.line.position[leg.first : leg.last + 1]
                axes.plot(way[:, left], way[:, right], "-", color=color, linewidth=1.0)
                goal = found.line.target[leg.first]
                axes.plot(goal[left], goal[right], ".", color="0.3", markersize=3)
        title = f"{task.robot}: {len(found.episodes)} episodes, green good, red poor"
        axes.set(xlabel=f"{AXES[left]} (m)", ylabel=f"{AXES[right]} (m)", title=title, aspect="equal")


def draw_joints(path: Path, found: Review, task: TaskDescription) -> None:
    """Joint angles over time, episodes shaded in turn."""
    seconds = np.array([found.seconds(int(moment)) for moment in found.line.moments])
    with picture(path, 9.0, 4.5) as axes:
        for episode in found.episodes[::2]:
            axes.axvspan(found.seconds(episode.first), found.seconds(episode.last), color="0.92", linewidth=0)
        for name, angles in zip(task.joint_names, found.line.q.T, strict=True):
            axes.plot(seconds, angles, linewidth=1.0, label=name)
        axes.set(xlabel="time (s)", ylabel="joint angle (rad)", title=f"{task.robot}: joints")
        axes.legend(fontsize="small", ncols=2)


def widest_plane(positions: Floats) -> tuple[int, int]:
    """The two axes, in order, of the greatest extent of positions (m), shape (k, 3)."""
    least = int(np.ptp(positions, axis=0)[::-1].argmin())
    left, right = (axis for axis in range(3) if axis != 2 - least)
    return left, right
