"""``demos check``: every fault of a bag, with episode, time and remedy."""

from dataclasses import dataclass
from pathlib import Path

import tyro
from rled_msgs_py.bags import Bag, Review, review
from rled_msgs_py.bags.faults import CLOCK_JUMP, LOST, NO_ORDER, Fault
from rled_msgs_py.errors import command
from rled_msgs_py.tick import STATE_TOPICS

from rled_teleop.recording.summary import counted


@dataclass(frozen=True)
class Check:
    """Name every fault of a bag. Exit code: 0 without faults, 1 with faults, 2 when it cannot be read."""

    bag: tyro.conf.Positional[Path]
    """rosbag2 folder, .mcap or .db3 file"""

    def run(self) -> int:
        """Check the bag; returns the exit code."""
        bag = Bag(self.bag, 1)
        for _ in bag.messages():  # every checksum and every count
            pass
        found = review(bag)
        if bag.note:
            print(bag.note)
        for fault in found.faults:
            print(line_of(fault, found, self.bag))
        if not (found.faults or bag.note):
            messages, episodes = counted(bag.message_count, "message"), counted(len(found.episodes), "episode")
            print(f"{self.bag}: no faults in {messages}, {episodes}")
        return 1 if found.faults or bag.note else 0


def line_of(fault: Fault, found: Review, path: Path) -> str:
    """A fault in one line: kind, where, what, remedy."""
    numbers = found.episodes_of(fault)
    begin, end = found.seconds(fault.first), found.seconds(fault.last)
    time = f"at {begin:.2f} s" if end - begin < 0.005 else f"from {begin:.2f} s to {end:.2f} s"
    topics = "all state topics" if len(fault.topics) > 3 else ", ".join(fault.topics)
    return f"{fault.kind}: {topics}, {_episodes(numbers)}, {time}: {fault.what}; {remedy(fault, found, path)}"


def remedy(fault: Fault, found: Review, path: Path) -> str:
    """The command that leaves a faulty part out and keeps the most."""
    moments = found.timeline.moments
    trim, drop = (command("demos", each, path) for each in ("trim", "drop"))
    if (
        fault.kind == NO_ORDER or found.timeline.is_anew[moments == fault.last].any()
    ):  # both sides cannot stay in one bag
        where = found.seconds((fault.first + fault.last) // 2)
        last = found.seconds(int(moments[-1])) if len(moments) else 0.0
        side = f"--to {_seconds(where)}" if where > last - where else f"--from {_seconds(where)}"
        return f"keep the longer part with: {trim} {side} --output NEW"
    before, after = moments[moments < fault.first], moments[moments > fault.last]
    if is_between_ticks(fault):  # which are sound themselves
        before, after = moments[moments <= fault.first], moments[moments >= fault.last]
    begin = found.seconds(int(before[-1]) + found.period // 2) if len(before) else None
    end = found.seconds(int(after[0]) - found.period // 2) if len(after) else None
    if begin is not None and end is not None:
        stretch = f"--from {_seconds(min(begin, end))} --to {_seconds(max(begin, end))}"
        return f"leave it out with: {drop} {stretch} --output NEW"
    if begin is not None:
        return f"keep what is before it with: {trim} --to {_seconds(begin)} --output NEW"
    if end is not None:
        return f"keep what is after it with: {trim} --from {_seconds(end)} --output NEW"
    return "record it again"


def is_between_ticks(fault: Fault) -> bool:
    """Whether a fault is told by the last sound tick before it and the first one after it."""
    return fault.kind == CLOCK_JUMP or (fault.kind == LOST and len(fault.topics) == len(STATE_TOPICS))


def _seconds(value: float) -> str:
    """To the microsecond, as short as it is."""
    return f"{value:.6f}".rstrip("0").rstrip(".")


def _episodes(numbers: list[int]) -> str:
    if not numbers:
        return "outside the episodes"
    if len(numbers) == 1:
        return f"episode {numbers[0]}"
    return f"episodes {numbers[0]} to {numbers[-1]}"
