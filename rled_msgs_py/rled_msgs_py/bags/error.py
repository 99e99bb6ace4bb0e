"""What goes wrong with a bag."""

from pathlib import Path

from rled_msgs_py.errors import RledError


class BagError(RledError):
    """A bag that is missing, unfinished, damaged or foreign, or that cannot be written."""


class Damage(Exception):
    """A part of a file that cannot be right; the text says which. It becomes a ``BagError`` where the file is known."""


def remedy(path: Path) -> str:
    """How a person mends an unfinished or damaged bag."""
    return f"save what is whole with: python -m rled_msgs_py.repair_bag {path}"
