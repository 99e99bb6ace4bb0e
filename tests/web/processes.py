"""The processes that this one has started, and what memory they have."""

import os
from pathlib import Path


def parents() -> dict[int, int]:
    """Each process of the machine, with its parent."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            found[int(folder.name)] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:  # it has ended meanwhile
            continue
    return found


def family() -> set[int]:
    """The processes below this one."""
    found, newest, of = set[int](), {os.getpid()}, parents()
    while newest:
        newest = {child for child, parent in of.items() if parent in newest}
        found |= newest
    return found


def words(process: int, what: str = "cmdline") -> list[str]:
    """Its command line, or its ``environ``; nothing of one that has ended."""
    try:
        return Path(f"/proc/{process}/{what}").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return []


def one_with(*parts: str) -> int:
    """The process below this one whose command line has all of these parts."""
    (found,) = (each for each in family() if all(any(part in word for word in words(each)) for part in parts))
    return found


def resident(process: int) -> float:
    """Resident memory (MB); NaN when it has ended."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
