"""What goes wrong with a bag."""

from pathlib import Path

from rled_msgs_py.errors import RledError, command


class BagError(RledError):
    """A bag that is missing, unfinished, damaged or foreign, or that cannot be written."""


class ForeignBag(BagError):
    """A bag that may be sound and is not read, so there is nothing to repair."""


class BagInUse(BagError):
    """A bag that another process is writing."""


class Unwritten(BagError):
    """A file that could not be written; ``reason`` is what the operating system says."""

    def __init__(self, what: str, accepted: str = "", remedy: str = "", reason: str = "") -> None:
        super().__init__(what, accepted, remedy)
        self.reason = reason


class Damage(Exception):
    """A part of a file that cannot be right; the text says which. It becomes a ``BagError`` where the file is known."""


class Oversized(Damage):
    """A part that is out of proportion to the file, and may be sound."""


def remedy(path: Path) -> str:
    """How a person mends an unfinished or damaged bag."""
    return f"save what is whole with: {command('demos', 'repair', path)}"
