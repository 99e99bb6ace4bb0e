"""Two thousand changed bags: each is refused in one line, or reads as what was recorded."""

import random
import shutil

import pytest
from rled_msgs_py.bags import Bag, review

from .samples import write_bag
from .test_bag_damage import TICKS, assert_refused_or_right, contents, outcome

SEEDS = range(8)
CHANGES = 250


def mutated(data: bytes, other: bytes, generator: random.Random) -> bytes:
    """The bytes with a bit flipped, an end cut, a part taken out or put in, or a part of another bag spliced in."""
    at, length = generator.randrange(len(data)), generator.randrange(1, 400)
    kind = generator.choice(["flip", "cut", "out", "in", "splice", "zero"])
    if kind == "flip":
        return data[:at] + bytes([data[at] ^ 1 << generator.randrange(8)]) + data[at + 1 :]
    if kind == "cut":
        return data[:at]
    if kind == "out":
        return data[:at] + data[at + length :]
    if kind == "in":
        return data[:at] + generator.randbytes(length) + data[at:]
    if kind == "splice":
        place = generator.randrange(len(other))
        return data[:at] + other[place : place + length] + data[at + length :]
    return data[:at] + bytes(min(length, len(data) - at)) + data[at + length :]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_mutated_bag_is_refused_or_right(tmp_path, seed):
    path = write_bag(tmp_path / "bag", ticks=TICKS, metadata={"seed": "7"})
    other = (write_bag(tmp_path / "other", ticks=9) / "other_0.mcap").read_bytes()
    expected, data = contents(path), (path / "bag_0.mcap").read_bytes()
    judged, generator = review(Bag(path)).qualities, random.Random(seed)
    shutil.copytree(path, tmp_path / "changed" / "bag")
    changed = tmp_path / "changed" / "bag"
    for _ in range(CHANGES):
        found = mutated(data, other, generator)
        (changed / "bag_0.mcap").write_bytes(found)
        assert_refused_or_right(changed, expected)
        assert_refused_or_right(changed / "bag_0.mcap", expected)
        looked_at = outcome(lambda each: review(Bag(each)), changed)
        assert looked_at is None or (looked_at.qualities == judged and not looked_at.faults)
