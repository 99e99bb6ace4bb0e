"""Bags that a killed recorder left behind, completed before the next recording."""

from pathlib import Path

from rled_msgs_py.bags import BagError, repair
from rled_msgs_py.bags.folder import mcap_files
from rled_msgs_py.bags.metadata import FILE_NAME


def repair_unfinished(folder: Path) -> list[str]:
    """Complete the unfinished bags in a folder; what somebody is recording is left alone.

    Returns:
        What was done to each, in words.
    """
    bags = [each for each in sorted(folder.iterdir()) if is_unfinished(each)] if folder.is_dir() else []
    return [said for bag in bags if (said := _repair(bag))]


def is_unfinished(path: Path) -> bool:
    """Whether a folder looks like a bag whose recorder did not end."""
    return path.is_dir() and not (path / FILE_NAME).exists() and bool(mcap_files(path))


def _repair(bag: Path) -> str:
    try:
        messages, lost = repair(bag)
    except BagError as error:
        return "" if "is being recorded" in error.what else f"{bag} was left unfinished: {error}"
    losses = f"; lost: {', '.join(lost)}" if lost else ""
    return f"{bag} was left unfinished and is repaired: it holds {messages} messages{losses}"
