"""The records of an MCAP file, told apart by their framing alone, packed, and the definitions among them.

The format: magic, records, magic. A record is an opcode (1 byte), the length of its content (8 bytes) and the content.
"""

from collections.abc import Iterator
from io import BytesIO
from mmap import mmap
from struct import Struct
from typing import Any

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, McapRecord, Schema

from rled_msgs_py.bags.error import Damage
from rled_msgs_py.bags.storage import BagTopic

MAGIC = b"\x89MCAP0\r\n"
HEAD = Struct("<BQ")
QOS, HASH = "offered_qos_profiles", "topic_type_hash"
"""What rosbag2 calls them in the metadata of a channel."""
NO_SCHEMA = Schema(data=b"", encoding="", id=0, name="")
"""For a channel that has none: MCAP allows that."""
MESSAGE_HEAD = Struct("<HIQQ")
"""Channel, number (MCAP's ``sequence``), log time, publish time (ns); the message follows."""


def packed(record: McapRecord) -> bytes:
    """The bytes of a record."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def message_record(channel: int, number: int, log_time: int, publish_time: int, data: bytes) -> bytes:
    """A message as a record; times in ns."""
    head = MESSAGE_HEAD.pack(channel, number & 0xFFFFFFFF, log_time, publish_time)
    return HEAD.pack(Opcode.MESSAGE, len(head) + len(data)) + head + data


def walk(data: mmap | bytes, start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of the content of each whole record; ends before one that does not fit or is none."""
    while stop - start >= HEAD.size:
        opcode, length = HEAD.unpack_from(data, start)
        start += HEAD.size
        if length > stop - start or not (opcode or length):  # zeros are what was never written
            return
        yield opcode, start, start + length
        start += length


def parse(kind: Any, data: mmap | bytes, start: int, stop: int) -> Any:
    """Read a record's content with the mcap library.

    Raises:
        Damage: it holds something else.
    """
    try:
        return kind.read(ReadDataStream(BytesIO(data[start:stop])))
    except Exception as error:  # the library raises whatever broken bytes lead it to
        raise Damage(f"the {kind.__name__} record at byte {start} cannot be read ({error})") from None


class Definitions:
    """Channels and message definitions, by their numbers in the file."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}

    def take(self, opcode: int, data: mmap | bytes, start: int, stop: int, *, prevails: bool = False) -> None:
        """Take up a record if it is a schema or a channel.

        Args:
            opcode: of the record.
            data: where it is.
            start: begin of its content.
            stop: end of its content.
            prevails: where its number has another meaning already, it has this one from now on.

        Raises:
            Damage: it cannot be read, or its number has another meaning already.
        """
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        kind, known = (Schema, self.schemas) if opcode == Opcode.SCHEMA else (Channel, self.channels)
        record = parse(kind, data, start, stop)
        if known.setdefault(record.id, record) != record:
            known[record.id] = record if prevails else known[record.id]
            raise Damage(f"{kind.__name__.lower()} {record.id} is defined twice, differently")

    def topic(self, channel: int) -> BagTopic:
        """The topic of a channel, with everything that the file says of it.

        Raises:
            Damage: it is not defined.
        """
        found = self.channels.get(channel)
        if not found:
            raise Damage(f"channel {channel} is not defined")
        schema = self.schemas.get(found.schema_id, NO_SCHEMA)
        details = tuple(sorted((key, text) for key, text in found.metadata.items() if key not in (QOS, HASH)))
        return BagTopic(
            found.topic,
            schema.name,
            found.message_encoding,
            schema.data.decode(errors="surrogateescape"),
            schema.encoding,
            found.metadata.get(HASH, ""),
            found.metadata.get(QOS, ""),
            details,
        )


def schema_of(topic: BagTopic, number: int) -> Schema:
    """The message definition of a topic, as it stands in a file."""
    text = topic.definition.encode(errors="surrogateescape")
    return Schema(data=text, encoding=topic.definition_encoding, id=number, name=topic.type)


def channel_of(topic: BagTopic, number: int, schema: int) -> Channel:
    """The channel of a topic, as it stands in a file; the schema 0 is none."""
    known = {key: text for key, text in ((QOS, topic.qos), (HASH, topic.hash)) if text}
    return Channel(number, topic.name, topic.encoding, known | dict(topic.details), schema)
