"""Pictures of learning and of motion, as PNG files that appear whole."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle
from numpy.typing import NDArray
from rled_msgs_py.pictures import picture
from rled_msgs_py.task import TaskDescription

from rled_agent.learners.cloning import CurvePoint

Floats = NDArray[np.float64]
PLANES = {(0, 1): ("x", "y"), (1, 2): ("y", "z"), (0, 2): ("x", "z")}


def drawn_plane(task: TaskDescription) -> tuple[int, int]:
    """The two position axes that a task's motions are drawn in: its own, or the Panda's front of one in space."""
    if len(task.axes) != 2:
        return 1, 2
    left, right = sorted(task.axes)
    return left, right


def draw_learning_curve(path: Path, curve: Sequence[CurvePoint]) -> None:
    """Loss of the expert network over gradient steps (the thesis's figure 4.3)."""
    with picture(path) as axes:
        steps = [point.step for point in curve]
        axes.semilogy(steps, [point.train for point in curve], label="training")
        axes.semilogy(steps, [point.validation for point in curve], label="validation")
        axes.set(xlabel="gradient step", ylabel="mean squared error $J_d$", title="Cloning the expert")
        axes.legend()


def draw_tool_paths(
    path: Path,
    known: tuple[str, Floats],
    goals: Floats,
    paths: Mapping[str, Sequence[Floats]],
    plane: tuple[int, int],
    radius: float,
    title: str,
) -> None:
    """End-effector paths on their way to targets, seen along the axis that is left out.

    Args:
        path: PNG to write.
        known: name of the points drawn small and grey, and the points (m), shape (k, 3).
        goals: targets drawn with the circle in which they count as reached (m), shape (g, 3).
        paths: by name, the paths (m) of its episodes, each of shape (t, 3); the last name is drawn on top.
        plane: the two position axes to draw.
        radius: of that circle (m).
        title: above the picture.
    """
    columns = list(plane)
    groups = {name: [each[:, columns] for each in group] for name, group in paths.items()}
    name, dots = known
    shown = np.concatenate(
        [dots[:, columns], goals[:, columns], *(each for group in groups.values() for each in group)]
    )
    with picture(path, *_size(shown, 2.0 * radius)) as axes:
        axes.plot(*dots[:, columns].T, ".", color="0.7", markersize=4, label=name, zorder=1)
        for k, (name, group) in enumerate(groups.items()):
            _draw_group(axes, name, group, f"C{k}")
        _draw_goals(axes, goals[:, columns], radius)
        labels = PLANES[plane]
        axes.set(xlabel=f"{labels[0]} (m)", ylabel=f"{labels[1]} (m)", title=title, aspect="equal")
        for line in axes.figure.legend(loc="outside lower center", ncols=2, frameon=False).get_lines():
            line.set_alpha(1.0)


def _size(points: Floats, margin: float) -> tuple[float, float]:
    """Width and height (inches) of a picture that points (m), shape (k, 2), fill at equal scales."""
    width, height = np.ptp(points, axis=0) + margin
    scale = min(7.0 / width, 6.0 / height)
    return max(width * scale, 5.0) + 1.0, max(height * scale, 1.5) + 1.5


def _draw_group(axes: Axes, name: str, group: Sequence[Floats], color: str) -> None:
    """Paths (m), shape (t, 2) each; the more there is of them, the fainter."""
    strength = float(np.clip(200.0 / sum(map(len, group)), 0.18, 0.9))
    for j, each in enumerate(group):
        axes.plot(
            *each.T, ".-", color=color, linewidth=1.2, markersize=3, alpha=strength, label=name if j == 0 else None
        )


def _draw_goals(axes: Axes, goals: Floats, radius: float) -> None:
    circles = [Circle((x, y), radius) for x, y in goals.tolist()]
    axes.add_collection(PatchCollection(circles, facecolor="none", edgecolor="C3", alpha=0.35, zorder=3))
    label = f"goal, reached within {100 * radius:.1f} cm"
    axes.plot(*goals.T, "o", color="C3", markersize=4, label=label, zorder=4)
