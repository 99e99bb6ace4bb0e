"""Bags that a killed recorder left behind, completed before the next recording."""

from pathlib import Path

from rled_msgs_py.bags import repair
from rled_msgs_py.bags.error import BagInUse
from rled_msgs_py.bags.folder import mcap_files
from rled_msgs_py.bags.mcap_writer import is_ours
from rled_msgs_py.bags.metadata import FILE_NAME


def repair_unfinished(folder: Path) -> list[str]:
    """Complete the unfinished bags in a folder; what somebody is recording is left alone.

    Whatever lies there, it never stops who calls.

    Returns:
        What was done to each, in words, one line each.
    """
    try:
        bags = sorted(folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        return [f"{folder} cannot be looked through for unfinished bags: {error.strerror}"]
    return [" ".join(said.split()) for bag in bags if (said := _repair(bag))]


def is_unfinished(path: Path) -> bool:
    """Whether a folder is a bag whose recorder, one of ours, did not end."""
    files = mcap_files(path) if path.is_dir() and not (path / FILE_NAME).exists() else []
    return bool(files) and all(map(is_ours, files))


def _repair(bag: Path) -> str:
    try:
        if not is_unfinished(bag):
            return ""
        messages, lost, kept = repair(bag)
    except BagInUse:
        return ""
    except Exception as error:  # a stranger's bag must not keep anybody from recording
        return f"{bag} was left unfinished: {str(error) or type(error).__name__}"
    losses = f"; lost: {', '.join(lost)}" if lost else ""
    files = f"; kept as they were: {', '.join(map(str, kept))}" if kept else ""
    return f"{bag} was left unfinished and is repaired: it holds {messages} messages{losses}{files}"
