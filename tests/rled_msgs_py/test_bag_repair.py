"""Repair never loses: what the mcap library reads of a bag before, it reads after, or more."""

import os
import random
import sys
from collections import Counter
from itertools import islice
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer
from rled_msgs_py.bags import Bag, BagError, BagWriter, repair, review, trim
from rled_msgs_py.bags.mcap_output import Output
from rled_msgs_py.bags.mcap_records import MAGIC, walk
from rled_msgs_py.bags.rescue import rescued
from rled_msgs_py.records import Text
from rled_msgs_py.topics import ROBOT_DESCRIPTION

from .made_bags import READERS, draw_bag, files_of, others, read, spoil
from .samples import write_bag

COUNT = int(os.environ.get("RLED_BAGS", "40"))
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


BAGS = Path(__file__).parents[2] / "bags"


def with_notes(path: Path, topic: str = "/notes") -> Path:
    """The planar bag, with a note in JSON on a channel without a schema after every 500th message."""
    with (BAGS / "planar_lemniscate" / "planar_lemniscate_0.mcap").open("rb") as source, path.open("wb") as file:
        writer, known = Writer(file, chunk_size=100_000), dict[object, int]()
        writer.start("ros2", "a lab")
        notes = writer.register_channel(topic, "json", 0)
        for number, (schema, channel, message) in enumerate(make_reader(source).iter_messages(), 1):
            assert schema
            if schema.name not in known:
                known[schema.name] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.topic not in known:
                about = channel.message_encoding, known[schema.name], channel.metadata
                known[channel.topic] = writer.register_channel(channel.topic, *about)
            writer.add_message(known[channel.topic], message.log_time, message.data, message.publish_time)
            if number % 500 == 0:
                writer.add_message(notes, message.log_time, b'{"note": 1}', message.publish_time)
        writer.finish()
    return path


def test_a_bag_with_channels_of_others_is_read_copied_and_left_as_it_is_by_repair(tmp_path: Path) -> None:
    path, planar = with_notes(tmp_path / "a.mcap"), Bag(BAGS / "planar_lemniscate")
    before, bag = path.read_bytes(), Bag(path)
    assert bag.counts - Counter({"notes": 12}) == planar.counts
    assert bag.counts["notes"] == planar.message_count // 500 == 12
    assert review(bag).qualities == review(planar).qualities
    assert repair(path) == (planar.message_count + 12, [], [])
    assert path.read_bytes() == before
    trim(bag, tmp_path / "copy", 0.0, 1e6, lambda _: None)
    notes = [each for each in Bag(tmp_path / "copy").messages() if each.topic.name == "/notes"]
    assert [(each.topic.encoding, each.topic.type, each.data) for each in notes] == [("json", "", b'{"note": 1}')] * 12


@pytest.mark.parametrize("name", ["task_description", "joint_states", "marked/ee_pose"])
def test_a_channel_of_others_with_the_name_of_one_of_ours_is_passed_over(tmp_path: Path, name: str) -> None:
    bag, planar = Bag(with_notes(tmp_path / "a.mcap", f"/{name}")), Bag(BAGS / "planar_lemniscate")
    assert bag.counts - planar.counts == Counter({f"{name} (json)": 12})
    assert (bag.task, bag.parts, bag.note) == (planar.task, 1, "")
    assert review(bag).faults == []
    assert len(list(bag.ticks())) == len(list(planar.ticks()))
    trim(bag, tmp_path / "copy", 0.0, 100.0, lambda _: None)
    assert Bag(tmp_path / "copy").counts == bag.counts


def test_what_packs_too_well_is_kept_as_it_is_so_that_what_is_recorded_is_read(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for number in range(60):
            writer.write(ROBOT_DESCRIPTION, Text(f"<robot>{number}{'<link/>' * 400_000}</robot>"), number)
    assert sum(file.stat().st_size for file in files_of(tmp_path / "bag")) > 60 * 7 * 400_000
    bag = Bag(tmp_path / "bag", 1)
    assert repair(tmp_path / "bag").lost == []
    assert bag.counts["robot_description"] == 60


def test_a_repaired_bag_keeps_the_channels_of_others(tmp_path: Path) -> None:
    path = with_notes(tmp_path / "a.mcap")
    before, beside = read(path), others(path)
    path.write_bytes(path.read_bytes()[:-50])
    assert repair(path) == (before.total(), [], [])
    assert (read(path), others(path)) == (before, beside)


@pytest.mark.parametrize("bit", [0, 5, 24, 32])
def test_a_wrong_length_in_the_middle_costs_nothing_that_the_summary_knows(tmp_path: Path, bit: int) -> None:
    path = with_notes(tmp_path / "a.mcap")
    data, whole = bytearray(path.read_bytes()), read(path)
    chunks = [start for opcode, start, _ in walk(bytes(data), len(MAGIC), len(data)) if opcode == Opcode.CHUNK]
    data[chunks[4] - 8 + bit // 8] ^= 1 << bit % 8  # of the length
    path.write_bytes(data)
    assert read(path, make_reader) == whole
    done = repair(path)
    assert read(path) == whole
    assert done.messages == whole.total()
    assert [each.read_bytes() for each in done.kept] == ([data] if done.lost else [])


MODULE = sys.modules[repair.__module__]
STEPS = {
    "writing": (Output, "write"),
    "proving": (MODULE, "require_all"),
    "keeping": (MODULE, "_keep"),
    "replacing": (Path, "replace"),
}


@pytest.mark.parametrize("change", [2**40, 7, 1, -1, -10])
def test_a_wrong_length_of_an_index_costs_no_message_of_a_file_without_a_summary(tmp_path: Path, change: int) -> None:
    (file,) = files_of(write_bag(tmp_path / "bag", ticks=20))
    data, ends = bytearray(file.read_bytes()), {Opcode.DATA_END, Opcode.FOOTER}
    records = list(walk(bytes(data), len(MAGIC), len(data)))
    whole = read(file.parent)
    cut = next(start - 9 for opcode, start, _ in records if opcode in ends)
    for opcode, start, stop in [each for each in records if each[0] == Opcode.MESSAGE_INDEX][::5]:
        changed = data[:cut]
        changed[start - 8 : start] = max(stop - start + change, 0).to_bytes(8, "little")
        file.write_bytes(changed)
        (file.parent / "metadata.yaml").unlink(missing_ok=True)
        done = repair(file.parent)
        assert opcode == Opcode.MESSAGE_INDEX
        assert done.messages == whole.total()
        for kept in done.kept:
            kept.unlink()


@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS.keys())
@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")], ids=["ctrl-c", "full"])
def test_a_repair_that_ends_in_the_middle_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: tuple[object, str], error: BaseException
) -> None:
    path = with_notes(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)

    def ends(*_: object) -> None:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(*step, ends)
        with pytest.raises((KeyboardInterrupt, BagError)):
            repair(path)
    assert path.read_bytes() == data
    assert not [each for each in tmp_path.iterdir() if each.is_dir()]
    done = repair(path)
    assert done.lost
    assert any(each.read_bytes() == data for each in done.kept)
    assert repair(path) == (done.messages, [], [])


def test_what_was_kept_is_never_replaced(tmp_path: Path) -> None:
    path = with_notes(tmp_path / "a.mcap")
    (tmp_path / "a.mcap.original").write_bytes(b"of an earlier repair")
    path.write_bytes(path.read_bytes()[:100_000])
    cut = path.read_bytes()
    assert repair(path).kept == [tmp_path / "a.mcap.2.original"]
    assert (tmp_path / "a.mcap.2.original").read_bytes() == cut
    assert (tmp_path / "a.mcap.original").read_bytes() == b"of an earlier repair"


def test_a_file_that_cannot_be_proven_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = with_notes(tmp_path / "a.mcap")
    path.write_bytes(path.read_bytes()[:-50])
    before = path.read_bytes()
    monkeypatch.setattr(MODULE, "rescued", lambda *of: islice(rescued(*of), 5, None))
    with pytest.raises(BagError, match="cannot be repaired without losing a message on /robot_description"):
        repair(path)
    assert path.read_bytes() == before


def test_a_file_without_anything_whole_stays_beside_those_that_are_repaired(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    first = with_notes(folder / "bag_0.mcap").read_bytes()
    (folder / "bag_1.mcap").write_bytes(first[:30])
    done = repair(folder)
    assert (len(done.lost), done.kept) == (1, [])
    assert "bag_1.mcap can be saved" in done.lost[0]
    assert [(folder / f"bag_{k}.mcap").read_bytes() for k in (0, 1)] == [first, first[:30]]
    assert Bag(folder).message_count == done.messages == 6073


def _within(less: Counter[object], more: Counter[object]) -> bool:
    return all(more[each] >= count for each, count in less.items())
