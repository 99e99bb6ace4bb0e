"""Pictures of learning and of motion, as PNG files that appear whole."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rled_msgs_py.files import whole_file

from rled_agent.expert import CurvePoint

Floats = NDArray[np.float64]
PLANES = {(0, 1): ("x", "y"), (1, 2): ("y", "z"), (0, 2): ("x", "z")}


@contextmanager
def picture(path: Path, width: float = 7.0, height: float = 4.5) -> Iterator[Axes]:
    """Axes whose picture is written to ``path`` when the block ends."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot()
    axes.grid(alpha=0.3)
    yield axes
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=120)


def draw_learning_curve(path: Path, curve: Sequence[CurvePoint]) -> None:
    """Loss of the expert network over gradient steps (the thesis's figure 4.3)."""
    with picture(path) as axes:
        steps = [point.step for point in curve]
        axes.semilogy(steps, [point.train for point in curve], label="training")
        axes.semilogy(steps, [point.validation for point in curve], label="validation")
        axes.set(xlabel="gradient step", ylabel="mean squared error $J_d$", title="Cloning the expert")
        axes.legend()


def draw_tool_paths(
    path: Path, targets: Floats, paths: Mapping[str, Sequence[Floats]], plane: tuple[int, int], title: str
) -> None:
    """End-effector paths and targets, seen along the axis that is left out.

    Args:
        path: PNG to write.
        targets: target points (m), shape (k, 3).
        paths: by name, the paths (m) of its episodes, each of shape (t, 3).
        plane: the two position axes to draw.
        title: above the picture.
    """
    first, second = plane
    with picture(path, 8.0, 5.0) as axes:
        axes.plot(targets[:, first], targets[:, second], "o", color="0.6", markersize=5, label="targets", zorder=1)
        for k, (name, episodes) in enumerate(paths.items()):
            for j, each in enumerate(episodes):
                label = name if j == 0 else None
                axes.plot(each[:, first], each[:, second], color=f"C{k}", linewidth=0.8, alpha=0.7, label=label)
        labels = PLANES[plane]
        axes.set(xlabel=f"{labels[0]} (m)", ylabel=f"{labels[1]} (m)", title=title, aspect="equal")
        axes.legend(loc="upper right")
