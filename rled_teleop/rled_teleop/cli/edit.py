"""``demos trim``, ``merge``, ``drop`` and ``repair``: new bags made of recorded ones."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rled_msgs_py.bags import Bag, drop, leave_out, merge, repair, trim
from rled_msgs_py.bags.copies import Report
from rled_msgs_py.errors import RledError

from rled_teleop.progress import Progress


@dataclass(frozen=True)
class Trim:
    """Copy a stretch of a bag."""

    bag: tyro.conf.Positional[Path]
    """rosbag2 folder, .mcap or .db3 file"""
    output: Path
    """folder of the new bag"""
    begin: Annotated[float, tyro.conf.arg(name="from")] = float("-inf")
    """seconds since the first state, by default from the begin"""
    end: Annotated[float, tyro.conf.arg(name="to")] = float("inf")
    """seconds since the first state, by default to the end"""
    part: int | None = None
    """of a bag during which the descriptions changed: which part, counted from 1, by default the first"""
    overwrite: bool = False
    """replace a bag that is there"""

    def run(self) -> int:
        """Copy; returns the exit code."""
        begin, end = _stretch(self.begin, self.end)
        bag, options = Bag(self.bag, self.part), {"overwrite": self.overwrite}
        return _made(self.output, [bag], lambda report: trim(bag, self.output, begin, end, report, **options))


@dataclass(frozen=True)
class Merge:
    """Copy several recordings of one robot and task behind each other; their episodes are numbered anew."""

    bags: tyro.conf.Positional[tuple[Path, ...]]
    """two bags or more"""
    output: Path = field(kw_only=True)
    """folder of the new bag"""
    overwrite: bool = False
    """replace a bag that is there"""

    def run(self) -> int:
        """Copy; returns the exit code."""
        if len(self.bags) < 2:
            raise RledError(f"{len(self.bags)} bags to merge", "2 or more")
        bags = [Bag(path) for path in self.bags]
        return _made(self.output, bags, lambda report: merge(bags, self.output, report, overwrite=self.overwrite))


@dataclass(frozen=True)
class Drop:
    """Copy a bag without some of its episodes, or without a stretch."""

    bag: tyro.conf.Positional[Path]
    """rosbag2 folder, .mcap or .db3 file"""
    output: Path
    """folder of the new bag"""
    episodes: str = ""
    """numbers as demos info counts them, separated by commas: 3,5"""
    begin: Annotated[float, tyro.conf.arg(name="from")] = float("-inf")
    """seconds since the first state: where the stretch begins"""
    end: Annotated[float, tyro.conf.arg(name="to")] = float("inf")
    """seconds since the first state: where the stretch ends"""
    overwrite: bool = False
    """replace a bag that is there"""

    def run(self) -> int:
        """Copy; returns the exit code."""
        has_stretch = (self.begin, self.end) != (float("-inf"), float("inf"))
        if has_stretch == bool(self.episodes):
            raise RledError("both are named" if has_stretch else "nothing to drop", "--episodes, or --from and --to")
        bag, options = Bag(self.bag), {"overwrite": self.overwrite}
        if has_stretch:
            begin, end = _stretch(self.begin, self.end)
            return _made(self.output, [bag], lambda report: leave_out(bag, self.output, begin, end, report, **options))
        numbers = _numbers(self.episodes)
        return _made(self.output, [bag], lambda report: drop(bag, self.output, numbers, report, **options))


@dataclass(frozen=True)
class Repair:
    """Complete a bag whose recorder was killed, or save what is whole of a damaged one.

    Changes the bag in place; a file of which something is lost is kept beside its successor.
    """

    bag: tyro.conf.Positional[Path]
    """rosbag2 folder or .mcap file"""

    def run(self) -> int:
        """Repair; returns the exit code."""
        print("\n".join(repair(self.bag).lines(self.bag)))
        return 0


def _made(output: Path, bags: list[Bag], make: Callable[[Report], int]) -> int:
    done = 0
    with closing(Progress("messages", sum(bag.message_count for bag in bags))) as progress:

        def report(count: int) -> None:
            nonlocal done
            done += count
            progress.show(done)

        count = make(report)
    print(f"{output} holds {count} messages")
    return 0


def _numbers(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not parts or not all(part.isascii() and part.isdigit() for part in parts):
        raise RledError(f"--episodes {text}", "numbers separated by commas, as in 3,5")
    return [int(part) for part in parts]


def _stretch(begin: float, end: float) -> tuple[float, float]:
    if not begin < end:
        raise RledError(f"--from {begin:g} --to {end:g}", "a stretch that ends after it begins")
    return begin, end
