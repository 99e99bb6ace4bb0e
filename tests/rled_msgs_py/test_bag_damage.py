"""A bag that is missing, foreign, cut or changed is refused in one clear line, and never read wrongly."""

import os
import random
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rled_msgs_py.bags import Bag, BagError, BagWriter, repair, review
from rled_msgs_py.records import Record
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.topics import EE_POSE, JOINT_DELTA, JOINT_STATES, RECORDED

from .samples import descriptions, recording, same, tick, write_bag

TICKS = 6


@dataclass(repr=False)
class Whole:
    """A small bag and what it holds."""

    path: Path
    contents: "Contents"


class Contents(NamedTuple):
    """Everything that a reader takes from a bag."""

    task: TaskDescription
    robot_description: str
    metadata: dict[str, str]
    counts: dict[str, int]
    records: dict[str, list[Record]]
    ticks: list[Record]
    tables: list[Any]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = write_bag(tmp_path_factory.mktemp("whole") / "bag", ticks=TICKS, metadata={"seed": "7"})
    return Whole(path, contents(path))


def contents(path):
    bag = Bag(path)
    records = {topic.name: list(bag.records(topic)) for topic in RECORDED}
    tables = [*bag.joints(JOINT_STATES), *bag.joints(JOINT_DELTA), *bag.poses(EE_POSE)]
    ticks = [part for each in bag.ticks() for part in each]
    return Contents(bag.task, bag.robot_description, bag.metadata, bag.counts, records, ticks, tables)


def equal(left, right):
    if isinstance(left, np.ndarray):
        return np.array_equal(left, right)
    if isinstance(left, dict):
        return left.keys() == right.keys() and all(equal(left[key], right[key]) for key in left)
    if isinstance(left, list | tuple):
        return len(left) == len(right) and all(map(equal, left, right))
    return left == right or same(left, right)


def outcome(call, path):
    """What a call returns, or None when it refuses the bag in one line that names it; any other error is a failure."""
    try:
        return call(path)
    except BagError as refusal:
        error = str(refusal)
    assert len(error.splitlines()) == 1
    assert str(path) in error
    return None


def assert_refused_or_right(path, expected):
    found = outcome(contents, path)
    assert found is None or equal(found, expected)


def changed(source, tmp_path_factory, name, data):
    path = tmp_path_factory.mktemp("changed") / "bag"
    shutil.copytree(source, path)
    (path / name).write_bytes(data)
    return path


@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_in_the_messages_is_refused_or_makes_no_difference(whole, tmp_path_factory, place, bit):
    source, expected = whole.path, whole.contents
    data = bytearray((source / "bag_0.mcap").read_bytes())
    data[int(place * len(data))] ^= 1 << bit
    path = changed(source, tmp_path_factory, "bag_0.mcap", data)
    assert_refused_or_right(path, expected)
    assert_refused_or_right(path / "bag_0.mcap", expected)
    shutil.rmtree(path.parent)


@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_in_the_metadata_is_refused_or_makes_no_difference(whole, tmp_path_factory, place, bit):
    source, expected = whole.path, whole.contents
    data = bytearray((source / "metadata.yaml").read_bytes())
    data[int(place * len(data))] ^= 1 << bit
    path = changed(source, tmp_path_factory, "metadata.yaml", data)
    assert_refused_or_right(path, expected)
    shutil.rmtree(path.parent)


@given(share=st.floats(0, 1, exclude_max=True))
def test_a_cut_file_is_refused(whole, tmp_path_factory, share):
    source = whole.path
    for name in ("bag_0.mcap", "metadata.yaml"):
        data = (source / name).read_bytes()
        if name == "metadata.yaml" and share > 0.9:
            continue  # its last field is the ROS distribution, which nobody needs
        path = changed(source, tmp_path_factory, name, data[: int(share * len(data))])
        with pytest.raises(BagError):
            Bag(path)
        shutil.rmtree(path.parent)


@given(st.binary(max_size=300), st.sampled_from(["bag_0.mcap", "metadata.yaml"]), st.booleans())
def test_a_file_of_anything_else_is_refused(whole, tmp_path_factory, data, name, headed):
    source = whole.path
    head = {"bag_0.mcap": b"\x89MCAP0\r\n", "metadata.yaml": b"rosbag2_bagfile_information:\n"}[name]
    path = changed(source, tmp_path_factory, name, head * headed + data)
    with pytest.raises(BagError):
        Bag(path)
    shutil.rmtree(path.parent)


@settings(max_examples=40)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_repaired_bag_holds_only_what_was_recorded(whole, tmp_path_factory, place, bit):
    source, metadata, records = whole.path, whole.contents.metadata, whole.contents.records
    data = bytearray((source / "bag_0.mcap").read_bytes())
    data[int(place * len(data))] ^= 1 << bit
    path = changed(source, tmp_path_factory, "bag_0.mcap", data)
    repaired = outcome(repair, path)
    if repaired is None:
        assert (path / "bag_0.mcap").read_bytes() == data
    else:
        bag = Bag(path)
        assert bag.message_count == repaired.messages
        assert repaired.lost or repaired.messages == 2 + 5 * TICKS
        assert bag.metadata == metadata or (not bag.metadata and repaired.lost)
        for topic in RECORDED:
            left = iter(records[topic.name])
            assert all(any(same(record, other) for other in left) for record in bag.records(topic))
    shutil.rmtree(path.parent)


def test_a_missing_bag_is_refused(tmp_path):
    with pytest.raises(BagError, match=r"nowhere does not exist; accepted: a rosbag2 folder or an \.mcap file"):
        Bag(tmp_path / "nowhere")


def test_an_empty_file_is_refused(tmp_path):
    (tmp_path / "a.mcap").touch()
    with pytest.raises(BagError, match=r"a\.mcap is empty"):
        Bag(tmp_path / "a.mcap")


@pytest.mark.parametrize("name", ["a.mcap", "a.bag", "a.txt"])
def test_another_file_is_refused(tmp_path, name):
    (tmp_path / name).write_text("hello, this is some text")
    with pytest.raises(BagError, match=r"is no (MCAP file|bag); accepted"):
        Bag(tmp_path / name)


def test_another_folder_is_refused(tmp_path):
    (tmp_path / "a.txt").touch()
    with pytest.raises(BagError, match=r"is no bag; accepted: a rosbag2 folder with metadata\.yaml and \.mcap files"):
        Bag(tmp_path)


def test_a_folder_of_which_the_file_is_missing_is_refused(whole, tmp_path):
    path = shutil.copytree(whole.path, tmp_path / "bag")
    (path / "bag_0.mcap").unlink()
    with pytest.raises(BagError, match=r"bag_0\.mcap cannot be read: No such file"):
        Bag(path)


def test_a_bag_without_metadata_is_unfinished_and_can_be_repaired(whole, tmp_path):
    path = shutil.copytree(whole.path, tmp_path / "bag")
    before = (path / "bag_0.mcap").read_bytes()
    (path / "metadata.yaml").unlink()
    with pytest.raises(BagError, match=r"no metadata\.yaml.*demos repair "):
        Bag(path)
    assert repair(path) == (2 + 5 * TICKS, [], [])
    assert equal(contents(path), whole.contents)
    assert (path / "bag_0.mcap").read_bytes() == before


def test_a_complete_bag_is_left_as_it_is(whole, tmp_path):
    path = shutil.copytree(whole.path, tmp_path / "bag")
    before = {each.name: (each.stat().st_mtime_ns, each.read_bytes()) for each in path.iterdir()}
    assert repair(path) == (2 + 5 * TICKS, [], [])
    assert {each.name: (each.stat().st_mtime_ns, each.read_bytes()) for each in path.iterdir()} == before


@pytest.mark.parametrize("name", ["nowhere", "empty"])
def test_there_is_nothing_to_repair_in_what_is_no_bag(tmp_path, name):
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match=f"{name} holds no .mcap file"):
        repair(tmp_path / name)


def test_a_bag_under_recording_is_not_repaired(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(*tick(0)[0])
        with pytest.raises(BagError, match=r"is being recorded; .*; end the recorder first"):
            repair(tmp_path / "bag")
        with pytest.raises(BagError, match=r"no metadata\.yaml"):
            Bag(tmp_path / "bag")
    assert Bag(tmp_path / "bag").message_count == 1


def test_a_bag_that_is_there_is_not_overwritten_unless_asked(whole, tmp_path):
    path = shutil.copytree(whole.path, tmp_path / "bag")
    with pytest.raises(BagError, match=r"bag exists; .*choose another name"):
        BagWriter(path)
    assert equal(contents(path), whole.contents)
    with BagWriter(path, overwrite=True) as writer:
        for topic, record in descriptions():
            writer.write(topic, record)
    assert Bag(path).message_count == 2


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_of_other_things_is_never_overwritten(tmp_path, overwrite):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(BagError, match=r"exists and is no bag: it holds thesis\.txt"):
        BagWriter(tmp_path, overwrite=overwrite)
    with pytest.raises(BagError, match="is a file"):
        BagWriter(tmp_path / "thesis.txt", overwrite=overwrite)
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match="cannot be made: Not a directory"):
        BagWriter(tmp_path / "file" / "bag")


LIMITED = """
import resource, sys
from pathlib import Path
from tests.rled_msgs_py.samples import recording
from rled_msgs_py.bags import BagWriter
from rled_msgs_py.messages import encode
from rled_msgs_py.errors import command_line

@command_line
def main():
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
    with BagWriter(Path(sys.argv[1])) as writer:
        for number, (topic, record) in enumerate(recording(400)):
            if sys.argv[3] == "kept":
                writer.keep(topic, encode(topic, record), getattr(record, "stamp", 0))
                print(number + 1, flush=True)
                continue
            writer.write(topic, record)
            if number % 10 == 9:
                writer.flush()
                print(number + 1, flush=True)
            if number % 50 == 49:
                writer.flush()

main()
"""


@pytest.mark.parametrize("how", ["kept", "flushed"])
@pytest.mark.parametrize("limit", [20_000, 33_333, 50_001])
def test_a_full_disk_is_one_line_that_says_what_was_kept(tmp_path, limit, how):
    path = tmp_path / "bag"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", LIMITED, str(path), str(limit), how]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    kept = int(done.stdout.splitlines()[-1])
    assert len(done.stderr.splitlines()) == 1
    assert f"File too large; kept: the first {kept} messages; free space, then save what is whole" in done.stderr
    assert repair(path) == (kept, [], [])
    bag = Bag(path)
    for topic in RECORDED:
        expected = [record for name, record in recording(400)[:kept] if name == topic]
        assert all(map(same, bag.records(topic), expected))
        assert bag.counts[topic.name] == len(expected)


def test_after_a_failure_every_call_says_so_and_closing_is_quiet(tmp_path, monkeypatch):
    writer = BagWriter(tmp_path / "bag")
    for topic, record in recording(3):
        writer.write(topic, record)
    writer.flush()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(writer._file._output, "write", full)
    writer.write(*tick(3)[0])
    for call in (writer.flush, lambda: writer.write(*tick(4)[0]), writer.flush):
        with pytest.raises(BagError, match="No space left on device; kept: the first 17 messages"):
            call()
    writer.close()
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
    assert repair(tmp_path / "bag") == (17, [], [])


# Two thousand changed bags: each is refused in one line, or reads as what was recorded.


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
