"""What strangers put into a bag costs no more memory or time than its size explains, and never a traceback."""

import os
import re
import shutil
import sqlite3
import struct
import subprocess
import sys

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer, Header, Schema, Statistics
from mcap.writer import Writer
from rled_msgs_py.bags import Bag, BagError, repair, review, trim
from rled_msgs_py.bags.folder import open_files
from rled_msgs_py.bags.mcap_chunks import CHUNK_HEAD, LENGTH
from rled_msgs_py.bags.mcap_records import HEAD, MAGIC, message_record, packed
from rled_msgs_py.bags.metadata import offered
from rled_msgs_py.bags.writer import BagWriter
from rled_msgs_py.records import Text
from rled_msgs_py.topics import EPISODE_EVENTS
from rosbags.rosbag2 import StoragePlugin

from .samples import recording, write_bag
from .test_bag_peers import write_with_rosbags

DEEP = "[" * 30_000
EXPANDING = "a0: &a0 [x, x]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}, *a{k - 1}]\n" for k in range(1, 40))
HUGE = "0x" + "f" * 5000
WRONG = {
    "relative_file_paths": ["bag_0.mcap", "{a: b}", "[[a]]", "[]", '["a\\0b.mcap"]', "['..']", "['']", "[/etc/passwd]",
                            "[../../etc/passwd]", "[bag_0.mcap, bag_0.mcap]", f"[{'a' * 300}.mcap]"],
    "message_count": [".inf", ".nan", "-1", "true", "'12'", "null", "[1]", HUGE, "9" * 390, "1" + ":11" * 200],
    "storage_identifier": ["[mcap]", "null", "other"],
    "compression_mode": ["[file]", "{a: b}", "file"],
    "custom_data": ["[1]", "{a: [b]}", "text", f"{{a: {HUGE}}}", "{a: {b: {c: d}}}"],
}  # fmt: skip
WHOLE_TEXTS = [
    DEEP,
    EXPANDING,
    "",
    "null",
    "5",
    "[1]",
    "a: &a [*a]",
    "!!python/name:os.system",
    "x: " + "a" * (5 << 20),
]


def refused(call, path):
    with pytest.raises(BagError) as error:
        call(path)
    assert len(str(error.value).splitlines()) == 1
    assert str(path) in str(error.value)
    assert len(str(error.value)) < 1000


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("whole") / "bag", ticks=6, metadata={"seed": "7"})


@pytest.mark.parametrize("field", WRONG)
def test_a_wrong_field_of_the_metadata_is_one_line(whole, tmp_path, field):
    text = (whole / "metadata.yaml").read_text()
    for number, value in enumerate(WRONG[field]):
        path = shutil.copytree(whole, tmp_path / str(number) / "bag")
        (path / "metadata.yaml").write_text(re.sub(rf"(?ms)^  {field}:.*?(?=^  \w)", f"  {field}: {value}\n", text))
        refused(Bag, path)


def test_metadata_that_are_none_are_one_line_and_repaired(whole, tmp_path):
    for number, text in enumerate(WHOLE_TEXTS):
        path = shutil.copytree(whole, tmp_path / str(number) / "bag")
        (path / "metadata.yaml").write_text(text)
        refused(Bag, path)
        done = repair(path)
        assert (done.messages, done.lost) == (32, [])
        assert [file.read_text() for file in done.kept] == [text]
        assert Bag(path).metadata == {"seed": "7"}


@pytest.mark.parametrize(
    "text", [*WHOLE_TEXTS[:2], *WHOLE_TEXTS[4:], "custom_data: [1]", f"custom_data: {{a: {HUGE}}}"]
)
def test_a_metadata_record_that_is_none_is_one_line(tmp_path, text):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "a test")
        writer.add_metadata("rosbag2", {"serialized_metadata": text})
        writer.finish()
    refused(Bag, tmp_path / "a.mcap")


@pytest.mark.parametrize("text", [DEEP, EXPANDING, "7", "- [1]", "- " * 70_000])
def test_a_quality_of_service_that_is_none_is_no_quality(tmp_path, text):
    assert offered(text) == []
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "a test")
        writer.add_message(writer.register_channel("/a", "json", 0, {"offered_qos_profiles": text}), 1, b"{}", 1)
        writer.finish()
    (tmp_path / "a.mcap").write_bytes((tmp_path / "a.mcap").read_bytes()[:-3])
    assert repair(tmp_path / "a.mcap").messages == 1
    (file,), _ = open_files(tmp_path / "a.mcap")
    assert [topic.qos for topic in file.topics.values()] == [text]


@pytest.mark.parametrize(
    "text", [DEEP, "{}", "[[1e999, 2]]", "[[1]]", '[["1", 2]]', f"[[1, {'9' * 30}]]", "[[true, 2]]", "]"]
)
def test_cuts_that_are_none_are_one_line(tmp_path, text):
    path = write_bag(tmp_path / "bag", ticks=6, metadata={"cuts": text})
    refused(lambda each: review(Bag(each)), path)


EVENT = '{"event": "start", "episode": %s, "stamp": %s}'


@pytest.mark.parametrize(
    "text",
    [DEEP, "[]", EVENT % ("1e999", 0), EVENT % (0, "1e999"), EVENT % (-1, 0), EVENT % ("true", 0), EVENT % (0, 2**70)],
)
def test_an_event_that_is_none_is_one_line(tmp_path, text):
    with BagWriter(tmp_path / "bag") as bag:
        for topic, record in [*recording(6), (EPISODE_EVENTS, Text(text))]:
            bag.write(topic, record)
    refused(lambda path: review(Bag(path)), tmp_path / "bag")
    refused(lambda path: trim(Bag(path), tmp_path / "out", 0.0, 1.0, lambda _: None), tmp_path / "bag")
    assert not (tmp_path / "out").exists()


def chunk(kind, content, size, crc=0):
    head = CHUNK_HEAD.pack(0, 0, size, crc, len(kind)) + kind.encode() + LENGTH.pack(len(content))
    return HEAD.pack(Opcode.CHUNK, len(head) + len(content)) + head + content


def mcap(path, data, summary=b""):
    begin = MAGIC + packed(Header("ros2", "a stranger")) + data + packed(DataEnd(0))
    path.write_bytes(begin + summary + packed(Footer(len(begin) if summary else 0, 0, 0)) + MAGIC)
    return path


BIG = 1 << 30
COUNTED = packed(Schema(1, b"", "ros2msg", "a/msg/B")) + packed(Channel(1, "/a", "cdr", {}, 1))
COUNTED += packed(Statistics(0, 1, {1: 1}, 1, 1, 0, 0, 0, 1))


@pytest.fixture(scope="module")
def zeros():
    """A gibibyte of zeros, packed."""
    return {
        "zstd": zstandard.ZstdCompressor().compress(bytes(BIG)),
        "zstd without a size": zstandard.ZstdCompressor(write_content_size=False).compress(bytes(BIG)),
        "lz4": lz4.frame.compress(bytes(BIG)),
    }


LIMITED = """
import sys
from pathlib import Path
from rled_msgs_py.bags import Bag, BagError, repair
for call in (lambda path: [*Bag(path).messages()], repair):
    try:
        call(Path(sys.argv[1]))
    except BagError as error:
        print(error)
print(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])  # ru_maxrss has the parent's
"""


@pytest.mark.parametrize("kind", ["zstd", "zstd without a size", "lz4"])
@pytest.mark.parametrize("form", ["one", "counted", "understated"])
def test_a_bomb_is_refused_before_the_memory_is_taken(tmp_path, zeros, kind, form):
    size = 1000 if form == "understated" else BIG
    data = chunk(kind.split()[0], zeros[kind], size, 5)
    assert_refused_cheaply(mcap(tmp_path / "a.mcap", data, COUNTED if form == "counted" else b""))


def test_many_small_bombs_are_refused_before_the_memory_is_taken(tmp_path):
    small = 8 << 20
    assert_refused_cheaply(mcap(tmp_path / "a.mcap", chunk("zstd", zstandard.compress(bytes(small)), small) * 60))


def assert_refused_cheaply(path):
    done = subprocess.run([sys.executable, "-c", LIMITED, str(path)], capture_output=True, text=True, check=True)
    *said, kilobytes = done.stdout.splitlines()
    assert len(said) == 2
    assert all(str(path) in line for line in said)
    assert int(kilobytes) < 400_000


def test_constant_images_are_read_although_they_pack_ten_thousand_times(tmp_path):
    image = bytes(1 << 20)
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file, chunk_size=4 << 20)
        writer.start("ros2", "a camera")
        channel = writer.register_channel("/camera", "cdr", writer.register_schema("a/msg/B", "ros2msg", b""))
        for number in range(30):
            writer.add_message(channel, number, image, number)
        writer.finish()
    assert [len(each.data) for each in Bag(tmp_path / "a.mcap").messages()] == [1 << 20] * 30


def test_twenty_thousand_channels_are_read_and_repaired(tmp_path):
    records = b"".join(
        packed(Schema(k, b"", "json", f"n{k}")) + packed(Channel(k, f"/t{k}", "json", {}, k)) for k in range(1, 20_001)
    )
    records += message_record(9, 0, 7, 7, b"{}")
    path = mcap(tmp_path / "a.mcap", chunk("zstd", zstandard.compress(records), len(records)))
    assert [each.topic.name for each in Bag(path).messages()] == ["/t9"]
    path.write_bytes(path.read_bytes()[:-3])
    assert repair(path).messages == 1


CLAIMS = {
    "a record of an exbibyte": HEAD.pack(Opcode.MESSAGE, 1 << 60),
    "a map of four gigabytes": HEAD.pack(Opcode.CHANNEL, 30)
    + struct.pack("<HHI2sI4sI", 1, 0, 2, b"/a", 4, b"json", (1 << 32) - 1)
    + bytes(8),
    "a text of four gigabytes": HEAD.pack(Opcode.SCHEMA, 30) + struct.pack("<HI", 1, (1 << 32) - 1) + bytes(24),
    "records of nothing": bytes(9) * 1000,
}


@pytest.mark.parametrize("claim", CLAIMS.values(), ids=CLAIMS.keys())
def test_a_record_that_claims_more_than_there_is_is_one_line(tmp_path, claim):
    path = mcap(tmp_path / "a.mcap", claim)
    for call in (Bag, repair):
        refused(call, path)
    path = mcap(tmp_path / "a.mcap", chunk("", claim, len(claim)))
    for call in (lambda each: [*Bag(each).messages()], repair):
        refused(call, path)


def test_a_pipe_is_no_bag(whole, tmp_path):
    os.mkfifo(tmp_path / "a.mcap")
    os.mkfifo(tmp_path / "a.db3")
    for call in (Bag, repair):
        refused(call, tmp_path / "a.mcap")
    refused(Bag, tmp_path / "a.db3")
    path = shutil.copytree(whole, tmp_path / "bag")
    (path / "metadata.yaml").unlink()
    os.mkfifo(path / "metadata.yaml")
    refused(Bag, path)


MISCHIEF = {
    "a view": "ALTER TABLE message_definitions RENAME TO d; CREATE VIEW message_definitions AS SELECT * FROM d",
    "a computed column": "ALTER TABLE messages ADD COLUMN x BLOB AS (zeroblob(1000000000)) VIRTUAL",
    "texts": "UPDATE messages SET data = 'text'",
    "times": "UPDATE messages SET timestamp = 'noon'",
    "great times": "UPDATE messages SET timestamp = 1e300",
    "no data": "ALTER TABLE messages RENAME COLUMN data TO date",
    "deep quality": f"UPDATE topics SET offered_qos_profiles = '{DEEP}'",
    "expanding quality": f"UPDATE topics SET offered_qos_profiles = '{EXPANDING}'",
    "an unknown language": "UPDATE message_definitions SET encoding = 'x'",
}


@pytest.mark.parametrize("change", MISCHIEF.values(), ids=MISCHIEF.keys())
def test_a_sqlite3_bag_with_hostile_rows_is_one_line(tmp_path, change):
    path = write_with_rosbags(tmp_path / "bag", recording(3), plugin=StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as rows:
        rows.executescript(change)
    rows.close()
    refused(lambda each: [*Bag(each).messages()], file)
