"""``demos check``: every fault of a bag, with episode, time and remedy."""

from dataclasses import dataclass
from pathlib import Path

import tyro
from rled_msgs_py.bags import Bag, Review, review
from rled_msgs_py.bags.faults import NO_ORDER, Fault

from rled_teleop.summary import counted


@dataclass(frozen=True)
class Check:
    """Name every fault of a bag. Exit code: 0 without faults, 1 with faults, 2 when it cannot be read."""

    bag: tyro.conf.Positional[Path]
    """rosbag2 folder, .mcap or .db3 file"""

    def run(self) -> int:
        """Check the bag; returns the exit code."""
        bag = Bag(self.bag)
        for _ in bag.messages():  # every checksum and every count
            pass
        found = review(bag)
        for fault in found.faults:
            print(line_of(fault, found, self.bag))
        if not found.faults:
            messages, episodes = counted(bag.message_count, "message"), counted(len(found.episodes), "episode")
            print(f"{self.bag}: no faults in {messages}, {episodes}")
        return 1 if found.faults else 0


def line_of(fault: Fault, found: Review, path: Path) -> str:
    """A fault in one line: kind, where, what, remedy."""
    numbers = found.episodes_of(fault)
    begin, end = found.seconds(fault.first), found.seconds(fault.last)
    time = f"at {begin:.2f} s" if end - begin < 0.005 else f"from {begin:.2f} s to {end:.2f} s"
    topics = "all state topics" if len(fault.topics) > 3 else ", ".join(fault.topics)
    return f"{fault.kind}: {topics}, {_episodes(numbers)}, {time}: {fault.what}; {remedy(fault, found, path)}"


def remedy(fault: Fault, found: Review, path: Path) -> str:
    """The command that leaves a faulty part out."""
    numbers = found.episodes_of(fault)
    begin, end = found.seconds(fault.first), found.seconds(fault.last)
    if fault.kind == NO_ORDER and end > begin:
        where = f"{(begin + end) / 2.0:.3f}"
        return f"keep one part with: demos trim {path} --to {where} --output NEW (or --from {where})"
    if numbers and len(numbers) < len(found.episodes):
        chosen = ",".join(map(str, numbers))
        return f"leave it out with: demos drop {path} --episodes {chosen} --output NEW"
    if begin > 0.0:
        return f"keep what is before it with: demos trim {path} --to {begin:.3f} --output NEW"
    return f"keep what is after it with: demos trim {path} --from {end + 0.001:.3f} --output NEW, or record it again"


def _episodes(numbers: list[int]) -> str:
    if not numbers:
        return "outside the episodes"
    if len(numbers) == 1:
        return f"episode {numbers[0]}"
    return f"episodes {numbers[0]} to {numbers[-1]}"
