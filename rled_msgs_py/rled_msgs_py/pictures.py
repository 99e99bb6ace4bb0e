"""Pictures as PNG files that appear whole."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rled_msgs_py.files import whole_file


@contextmanager
def picture(path: Path, width: float = 7.0, height: float = 4.5) -> Iterator[Axes]:
    """Axes whose picture is written to ``path`` when the block ends."""
    with stacked(path, 1, width, height) as (axes,):
        yield axes


@contextmanager
def stacked(path: Path, count: int, width: float = 7.0, height: float = 4.5) -> Iterator[list[Axes]]:
    """Several axes, one above the other, whose picture is written to ``path`` when the block ends."""
    figure = Figure(figsize=(width, count * height), layout="constrained")
    parts = figure.subfigures(count, 1, squeeze=False)[:, 0]
    all_axes = [part.add_subplot() for part in parts]
    for axes in all_axes:
        axes.grid(alpha=0.3)
    yield all_axes
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=120)


def legend_beside(axes: Axes) -> None:
    """A legend to the right of the axes, where it covers nothing."""
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
