"""Whatever lies beside a new recording, it never stops the recorder."""

import os
import shutil
import struct
from pathlib import Path

import pytest
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.topics import JOINT_DELTA
from rled_teleop.recording.bag_messages import is_of_ros, quality, read_recording
from rled_teleop.recording.unfinished import repair_unfinished

from tests.rled_msgs_py.samples import recording, write_bag
from tests.rled_msgs_py.test_bag_hostile import DEEP, EXPANDING
from tests.rled_msgs_py.test_bag_peers import write_with_mcap


def unfinished(path: Path) -> Path:
    write_bag(path, ticks=3, metadata={"seed": "7"})
    (path / "metadata.yaml").unlink()
    return path / f"{path.name}_0.mcap"


def test_an_unfinished_bag_is_completed_and_said_in_one_line(tmp_path: Path) -> None:
    unfinished(tmp_path / "bag")
    said = f"{tmp_path / 'bag'} was left unfinished and is repaired: it holds 17 messages"
    assert repair_unfinished(tmp_path) == [said]
    assert Bag(tmp_path / "bag").metadata == {"seed": "7"}
    assert repair_unfinished(tmp_path) == []


@pytest.mark.parametrize("text", [DEEP, EXPANDING, "custom_data: [1]"])
def test_hostile_metadata_in_an_unfinished_bag_are_said_in_one_line(tmp_path: Path, text: str) -> None:
    file = unfinished(tmp_path / "bag")
    data = file.read_bytes()
    at = data.index(b"serialized_metadata") + len(b"serialized_metadata")
    (size,) = struct.unpack_from("<I", data, at)
    record = data.rindex(b"\x0c", 0, at)
    sizes = struct.unpack_from("<QI", data, record + 1)[0], len(text.encode()) - size
    grown = bytearray(data[:at] + struct.pack("<I", len(text.encode())) + text.encode() + data[at + 4 + size :])
    struct.pack_into("<Q", grown, record + 1, sum(sizes))
    name = record + 1 + 8
    (length,) = struct.unpack_from("<I", grown, name)
    struct.pack_into("<I", grown, name + 4 + length, struct.unpack_from("<I", data, name + 4 + length)[0] + sizes[1])
    file.write_bytes(grown)
    (said,) = repair_unfinished(tmp_path)
    assert said.startswith(f"{tmp_path / 'bag'} was left unfinished and is repaired: it holds 17 messages; lost: ")
    assert "its metadata record is no YAML" in said
    assert Bag(tmp_path / "bag").message_count == 17


def test_a_bag_that_raises_whatever_it_likes_is_said_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    unfinished(tmp_path / "one")
    unfinished(tmp_path / "two")

    def raising(bag: Path) -> None:
        raise RecursionError("first\nsecond") if bag.name == "one" else MemoryError

    monkeypatch.setattr("rled_teleop.recording.unfinished.repair", raising)
    assert repair_unfinished(tmp_path) == [
        f"{tmp_path / 'one'} was left unfinished: first second",
        f"{tmp_path / 'two'} was left unfinished: MemoryError",
    ]


def test_what_is_recorded_by_others_or_just_now_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "lab").mkdir()
    write_with_mcap(tmp_path / "lab" / "a.mcap", recording(3))
    (tmp_path / "pipes").mkdir()
    os.mkfifo(tmp_path / "pipes" / "a.mcap")
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "a.mcap").touch()
    shutil.copy(__file__, tmp_path)
    with BagWriter(tmp_path / "bag") as writer:
        for topic, record in recording(3):
            writer.write(topic, record)
        assert repair_unfinished(tmp_path) == []
    assert sorted(each.name for each in (tmp_path / "lab").iterdir()) == ["a.mcap"]
    assert repair_unfinished(tmp_path / "nowhere") == []


def test_a_recording_is_played_without_the_channels_of_others(tmp_path: Path) -> None:
    from tests.rled_msgs_py.test_bag_repair import with_notes

    played = read_recording(with_notes(tmp_path / "a.mcap"))
    assert "/notes" not in {topic.name for topic in played.topics}
    assert len(played.data) == 6061
    assert all(map(is_of_ros, played.topics))
    assert {topic.name: quality(topic) for topic in played.topics}["/joint_delta"] == JOINT_DELTA.qos


@pytest.mark.parametrize(
    ("text", "depth"),
    [("4000000000", 10_000), ("-4", 1), ("7", 7), (".inf", 10), ("true", 10), ("[1]", 10), ("0x" + "f" * 5000, 10_000)],
)
def test_the_depth_of_a_bag_is_bounded(tmp_path: Path, text: str, depth: int) -> None:
    topic = read_recording(write_bag(tmp_path / "bag", ticks=1)).topics[0]
    qos = f"- {{depth: {text}, reliability: reliable, durability: volatile}}"
    assert quality(topic._replace(qos=qos)).depth == depth
