"""Repair never loses: what the mcap library reads of a bag before, it reads after, or more."""

import os
import random
from collections import Counter
from pathlib import Path

import pytest
from rled_msgs_py.bags import BagError, repair

from .made_bags import READERS, draw_bag, files_of, others, read, spoil

COUNT = int(os.environ.get("REPAIRED_BAGS", "40"))
"""Bags of each property; ``make repairs`` draws 500."""


@pytest.mark.parametrize("part", range(4))
def test_a_sound_bag_is_as_rich_after_repair_as_before(tmp_path: Path, part: int) -> None:
    for number in range(part, COUNT, 4):
        bag = draw_bag(tmp_path / f"bag{number}", random.Random(number))
        before, beside = [read(bag, kind) for kind in READERS], others(bag)
        try:
            done = repair(bag)
        except BagError:
            assert not before[0]
            continue
        assert not done.lost
        assert not done.kept
        assert done.messages == before[0].total()
        assert [read(bag, kind) for kind in READERS] == before
        assert others(bag) == beside
        assert repair(bag) == done


@pytest.mark.parametrize("part", range(4))
def test_a_damaged_bag_is_as_rich_after_repair_as_before_and_the_original_stays(tmp_path: Path, part: int) -> None:
    for number in range(part, COUNT, 4):
        generator = random.Random(number)
        bag = draw_bag(tmp_path / f"bag{number}", generator)
        spoil(bag, generator)
        before, files = read(bag), [file.read_bytes() for file in files_of(bag)]
        try:
            done = repair(bag)
        except BagError:
            assert [file.read_bytes() for file in files_of(bag)] == files
            continue
        after = read(bag)
        assert _within(before, after)
        if done.lost:
            assert done.kept or "can be saved" in done.lost[-1]
            folder = bag if bag.is_dir() else bag.parent
            assert set(files) <= {file.read_bytes() for file in folder.glob("bag*.mcap*")}


def _within(less: Counter[object], more: Counter[object]) -> bool:
    return all(more[each] >= count for each, count in less.items())
