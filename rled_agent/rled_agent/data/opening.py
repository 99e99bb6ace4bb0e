"""A bag's demonstrations, of either kind."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from rled_msgs_py.bags import Bag

from rled_agent.data.closed_form import joined_points
from rled_agent.data.corruption import NO_CORRUPTION, Corruption
from rled_agent.data.demonstrations import DemonstrationError, Demonstrations
from rled_agent.data.episode_filter import select_episodes, select_points
from rled_agent.data.recorded import recorded_trajectories

Source = Literal["points", "trajectories"]


def open_demonstrations(
    path: str | Path,
    source: Source = "points",
    min_quality: float = 0.0,
    say: Callable[[str], None] = lambda _: None,
    points: int = 0,
    corruption: Corruption = NO_CORRUPTION,
) -> Demonstrations:
    """Open a bag's demonstrations.

    Args:
        path: the bag.
        source: ``points`` (ζᵇ in closed form) or ``trajectories`` (as recorded).
        min_quality: least quality of an episode, for ``trajectories`` only.
        say: takes a line for each part that is left out.
        points: take only so many marked points, 0 for all; for ``points`` only.
        corruption: how poor they are made; for ``points`` only.

    Raises:
        RledError: the bag is damaged or faulty, or holds nothing of the kind.
    """
    bag = Bag(Path(path))
    if source == "points":
        if min_quality > 0.0:
            raise DemonstrationError(f"--min-quality {min_quality:g} with --source points", "--source trajectories")
        select_points(bag, say)
        return joined_points(bag, points, corruption)
    if corruption != NO_CORRUPTION:
        raise DemonstrationError("--corruption with --source trajectories", "--source points")
    if points:
        raise DemonstrationError(f"--points {points} with --source trajectories", "--source points")
    return recorded_trajectories(bag, select_episodes(bag, min_quality, say))
