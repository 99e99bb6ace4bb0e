"""Bags of many makers, drawn at random, and what the mcap library reads of them."""

import random
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap import stream_reader
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rled_msgs_py.bags import BagWriter
from rled_msgs_py.bags.metadata import FILE_NAME
from rled_msgs_py.bags.writer import describe
from rled_msgs_py.messages import encode
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from .samples import recording

MESSAGES = ("json", "protobuf", "", "cdr")
Content = Counter[tuple[str, int, int, bytes]]


def draw_bag(path: Path, generator: random.Random) -> Path:
    """Make a sound bag of a random maker; returns its folder or its one file."""
    maker = generator.choice([mcap_file, mcap_file, mcap_file, mcap_folder, rosbags_folder, own_folder])
    return maker(path, generator)


def mcap_folder(path: Path, generator: random.Random) -> Path:
    """Several files in one folder, without metadata."""
    path.mkdir()
    for number in range(generator.randrange(1, 4)):
        mcap_file(path / f"{path.name}_{number}", generator)
    return path


def mcap_file(path: Path, generator: random.Random) -> Path:
    """A file of the mcap library, with whatever MCAP allows beside the messages of ROS."""
    path = path.with_name(path.name + ".mcap")
    with path.open("wb") as file:
        writer = Writer(file, **_options(generator))
        writer.start(generator.choice(["ros2", "", "x-lab"]), "a maker")
        channels = _Channels(writer, generator)
        for number, (topic, record) in enumerate(recording(generator.choice([0, 1, 4, 30]))):
            time = generator.choice([number, number, generator.randrange(10**18), 2**63 + number])
            writer.add_message(channels.of(topic), time, encode(topic, record), time + generator.randrange(2), number)
            if generator.random() < 0.2:
                name, data = f"notes{generator.randrange(5)}", generator.randbytes(generator.choice([0, 1, 50, 5000]))
                writer.add_message(channels.foreign("/" * generator.randrange(2) + name), time, data, time, number)
            if generator.random() < 0.02:
                writer.add_attachment(1, 2, f"note {number}.txt", "text/plain", generator.randbytes(30))
            if generator.random() < 0.02:
                writer.add_metadata("of the lab", {"seed": str(number)})
        writer.finish()
    return path


def _options(generator: random.Random) -> dict[str, Any]:
    return {
        "chunk_size": generator.choice([1, 600, 5000, 1 << 20]),
        "compression": generator.choice(list(CompressionType)),
        "index_types": generator.choice([IndexType.ALL, IndexType.NONE, IndexType.ALL & ~IndexType.MESSAGE]),
        "repeat_channels": generator.random() < 0.7,
        "repeat_schemas": generator.random() < 0.7,
        "use_chunking": generator.random() < 0.7,
        "use_statistics": generator.random() < 0.7,
        "use_summary_offsets": generator.random() < 0.7,
        "enable_crcs": generator.random() < 0.7,
        "enable_data_crcs": generator.random() < 0.5,
    }


class _Channels:
    def __init__(self, writer: Writer, generator: random.Random) -> None:
        self._writer, self._generator = writer, generator
        self._known = dict[Any, int]()
        self._details = generator.choice([{}, {"calibration": "ü 1", "offered_qos_profiles": "- nonsense: ["}])

    def of(self, topic: Any) -> int:
        if topic not in self._known:
            found = describe(topic)
            schema = self._writer.register_schema(found.type, "ros2msg", found.definition.encode())
            self._known[topic] = self._writer.register_channel(found.name, "cdr", schema, self._details)
        return self._known[topic]

    def foreign(self, name: str) -> int:
        if name not in self._known:
            schema = 0
            if self._generator.random() < 0.5:
                schema = self._writer.register_schema("x.Note", "protobuf", self._generator.randbytes(40))
            encoding = self._generator.choice(MESSAGES)
            self._known[name] = self._writer.register_channel(name, encoding, schema, self._details)
        return self._known[name]


def rosbags_folder(path: Path, generator: random.Random) -> Path:
    """A bag as rosbags writes it."""
    writer = RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.MCAP)
    if generator.random() < 0.5:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    writer.set_custom_data("seed", "7")
    store, connections = get_typestore(Stores.ROS2_JAZZY), dict[str, Any]()
    with writer:
        for number, (topic, record) in enumerate(recording(generator.choice([1, 30]))):
            if topic.name not in connections:
                connections[topic.name] = writer.add_connection("/" + topic.name, topic.type, typestore=store)
            writer.write(connections[topic.name], number, encode(topic, record))
    _forget_metadata(path, generator)
    return path


def own_folder(path: Path, generator: random.Random) -> Path:
    """A bag as this project writes it."""
    with BagWriter(path, metadata={"seed": "7"}) as bag:
        for topic, record in recording(generator.choice([1, 30])):
            bag.write(topic, record)
            if generator.random() < 0.1:
                bag.flush()
    _forget_metadata(path, generator)
    return path


def _forget_metadata(path: Path, generator: random.Random) -> None:
    if generator.random() < 0.5:
        (path / FILE_NAME).unlink()


def spoil(path: Path, generator: random.Random) -> None:
    """Cut a bag's file, flip a bit in it, or overwrite a part."""
    file = generator.choice(files_of(path))
    data = bytearray(file.read_bytes())
    at = generator.randrange(len(data))
    kind = generator.choice(["cut", "flip", "flip", "zero", "out"])
    if kind == "cut":
        del data[at:]
    elif kind == "flip":
        data[at] ^= 1 << generator.randrange(8)
    elif kind == "zero":
        data[at : at + 40] = bytes(len(data[at : at + 40]))
    else:
        del data[at : at + generator.randrange(1, 300)]
    file.write_bytes(data)


def files_of(path: Path) -> list[Path]:
    """The .mcap files of a bag."""
    return sorted(path.glob("*.mcap")) if path.is_dir() else [path]


class _Strict(ReadDataStream):
    """The library takes the rest of a file or a chunk for a message that breaks off there; a sound reader does not."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def read(path: Path, kind: Any = NonSeekingReader) -> Content:
    """What the mcap library reads of a bag, up to the first error in each file: topic, times and data."""
    found = Content()
    for file in files_of(path):
        with file.open("rb") as opened:
            for channel, message in _messages(opened, kind):
                found[(channel.topic, message.log_time, message.publish_time, message.data)] += 1
    return found


def _messages(file: Any, kind: Any) -> list[tuple[Any, Any]]:
    found = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stream_reader, "ReadDataStream", _Strict)
        try:
            for _, channel, message in kind(file, validate_crcs=True).iter_messages(log_time_order=False):
                found.append((channel, message))
        except Exception:  # the library raises whatever broken bytes lead it to
            pass
    return found


def others(path: Path) -> list[Any]:
    """Attachments, metadata of others and channels of a sound bag."""
    found = list[Any]()
    for file in files_of(path):
        with file.open("rb") as opened:
            found += NonSeekingReader(opened).iter_attachments()
        with file.open("rb") as opened:
            found += [each for each in NonSeekingReader(opened).iter_metadata() if each.name != "rosbag2"]
        with file.open("rb") as opened:
            channels = [(channel, schema) for schema, channel, _ in NonSeekingReader(opened).iter_messages()]
            found += sorted({_described(*each) for each in channels})
    return found


def _described(channel: Any, schema: Any) -> tuple[Any, ...]:
    kind = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
    return (channel.topic, channel.message_encoding, *sorted(channel.metadata.items()), *kind)


def copied(path: Path, to: Path) -> Path:
    """A copy of a bag's folder or file."""
    return Path(shutil.copytree(path, to) if path.is_dir() else shutil.copy(path, to.with_suffix(".mcap")))


READERS = (NonSeekingReader, make_reader)
"""Sound readers: from the begin to the end, and by the index."""
