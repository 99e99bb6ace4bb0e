"""``demos plot``: paths of the end effector and joint curves as PNG."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from rled_msgs_py.bags import Bag, Review, review
from rled_msgs_py.bags.series import Floats
from rled_msgs_py.errors import RledError
from rled_msgs_py.outputs import require_output
from rled_msgs_py.pictures import legend_beside, picture
from rled_msgs_py.task import TaskDescription

from rled_teleop.recording.summary import counted

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
        if not len(found.timeline.moments):
            raise RledError(f"{self.bag} has no ticks to draw", "a bag with states")
        draw_paths(self.output / "paths.png", found, bag.task)
        draw_joints(self.output / "joints.png", found, bag.task)
        print(f"wrote {self.output / 'paths.png'} and {self.output / 'joints.png'}")
        return 0


def draw_paths(path: Path, found: Review, task: TaskDescription) -> None:
    """Paths of the end effector, seen along the axis of the smallest extent; green is good, red is poor."""
    left, right = widest_plane(found.timeline.position)
    with picture(path, 7.5, 6.0) as axes:
        for episode, quality in zip(found.episodes, found.qualities, strict=True):
            for segment in episode.segments:
                line = found.timeline.position[segment.first : segment.last + 1]
                axes.plot(line[:, left], line[:, right], "-", color=_colour(quality.score), linewidth=1.0)
                goal = found.timeline.target[segment.first]
                axes.plot(goal[left], goal[right], ".", color="0.3", markersize=3)
        for label, score in (("path, quality 1", 1.0), ("path, quality 0", 0.0)):
            axes.plot([], [], "-", color=_colour(score), label=label)
        axes.plot([], [], ".", color="0.3", label="target")
        title = f"{task.robot}: {counted(len(found.episodes), 'episode')}"
        axes.set(xlabel=f"{AXES[left]} (m)", ylabel=f"{AXES[right]} (m)", title=title, aspect="equal")
        legend_beside(axes)


def draw_joints(path: Path, found: Review, task: TaskDescription) -> None:
    """Joint angles over time, every other episode shaded."""
    seconds = np.array([found.seconds(int(moment)) for moment in found.timeline.moments])
    with picture(path, 9.0, 4.5) as axes:
        for number, episode in enumerate(found.episodes[::2]):
            label = "_" if number else "episodes 0, 2, 4 ..." if len(found.episodes) > 2 else "episode 0"
            span = found.seconds(episode.first), found.seconds(episode.last)
            axes.axvspan(*span, color="0.88", linewidth=0, label=label)
        for name, angles in zip(task.joint_names, found.timeline.q.T, strict=True):
            axes.plot(seconds, angles, linewidth=1.0, label=name)
        axes.set(xlabel="time (s)", ylabel="joint angle (rad)", title=f"{task.robot}: joints")
        legend_beside(axes)


def _colour(score: float) -> tuple[float, float, float, float]:
    return (1.0 - score, 0.75 * score, 0.1, 0.6)


def widest_plane(positions: Floats) -> tuple[int, int]:
    """The two axes, in order, of the largest extent of positions (m), shape (k, 3)."""
    narrowest = int(np.ptp(positions, axis=0)[::-1].argmin())
    left, right = (axis for axis in range(3) if axis != 2 - narrowest)
    return left, right
