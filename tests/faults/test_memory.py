"""What a stranger sends in large messages is paid for as long as they last, not longer."""

from pathlib import Path

from ..graph.team import actor_like
from .memory import measure

SECONDS = 5.0


def test_memory_comes_back_after_large_messages(planar_expert: Path, tmp_path: Path) -> None:
    """Nodes have grown by a tenth at most; before, each kept several times what it needs."""
    actor = actor_like(planar_expert, tmp_path / "actor.safetensors")
    figures = measure(SECONDS, tmp_path, planar_expert, actor)
    kept = {name: round(after / before - 1.0, 2) for name, (before, _, after) in figures.items()}
    assert max(kept.values()) < 0.2, figures
