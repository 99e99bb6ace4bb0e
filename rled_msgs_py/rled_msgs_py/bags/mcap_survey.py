"""The records of an MCAP file, found by their framing alone, so that an unfinished file can be read too.

The format: magic, records, magic. A record is an opcode (1 byte), a length (8 bytes) and its content. Messages lie in
chunks, which are runs of records compressed as one; an index of its messages follows each chunk. ``DataEnd`` closes the
data and carries its checksum; the summary that follows repeats the definitions and counts the messages.
"""

from collections.abc import Iterator
from io import BytesIO
from mmap import mmap
from struct import Struct
from struct import error as StructError
from typing import Any, NamedTuple
from zlib import crc32

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer, Metadata, Schema, Statistics

from rled_msgs_py.bags.error import Damage
from rled_msgs_py.bags.metadata import custom_data

MAGIC = b"\x89MCAP0\r\n"
HEAD = Struct("<BQ")
CHUNK_HEAD = Struct("<QQQI")
LARGEST_CHUNK = 1 << 31
METADATA = "rosbag2"
"""Name of the metadata record in which rosbag2 repeats its ``metadata.yaml``."""


class Chunk(NamedTuple):
    """Where a chunk lies.

    Attributes:
        compression: ``zstd``, ``lz4`` or empty.
        size: bytes of its records when unpacked.
        crc: of those bytes, 0 when it was not computed.
        start: where the packed bytes begin.
        stop: where they end.
        indexes: by channel, where its message index begins and ends (pairs of log time and offset).
    """

    compression: str
    size: int
    crc: int
    start: int
    stop: int
    indexes: dict[int, tuple[int, int]]


def walk(data: mmap | bytes, start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, begin and end of the content of each whole record; ends before one that does not fit."""
    while stop - start >= HEAD.size:
        opcode, length = HEAD.unpack_from(data, start)
        start += HEAD.size
        if length > stop - start:
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


def unpack(data: mmap | bytes, chunk: Chunk) -> bytes:
    """The records of a chunk.

    Raises:
        Damage: they cannot be unpacked, or their checksum differs.
    """
    packed, where = data[chunk.start : chunk.stop], f"the chunk at byte {chunk.start}"
    if chunk.size > LARGEST_CHUNK:
        raise Damage(f"{where} claims {chunk.size} bytes")
    try:
        records = _inflate(packed, chunk)
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise Damage(f"{where} cannot be unpacked ({error})") from None
    if len(records) != chunk.size or (chunk.crc and crc32(records) != chunk.crc):
        raise Damage(f"{where} fails its checksum")
    return records


def _inflate(packed: bytes, chunk: Chunk) -> bytes:
    if chunk.compression == "zstd":
        if zstandard.frame_content_size(packed) not in (-1, chunk.size):
            raise Damage(f"the chunk at byte {chunk.start} fails its checksum")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=chunk.size)
    if chunk.compression == "lz4":
        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=chunk.size)
        return unpacked
    if chunk.compression:
        raise Damage(f"the chunk at byte {chunk.start} is packed by '{chunk.compression}', not by zstd or lz4")
    return packed


class Survey:
    """What a file holds, up to its footer or to the first record that is not whole.

    Attributes:
        chunks: in the order of the file; loose messages count as one more chunk without an index.
        schemas: message definitions by number.
        channels: channels by number.
        custom: the user's metadata.
        statistics: counts of the summary, when there is one.
        footer: the last record, when the file has it.
        data_end: where the data ends.
        data_crc: checksum of the data, 0 when it was not computed.
        end: where the last whole record ends.
        damage: what cannot be right.
    """

    def __init__(self, data: mmap | bytes) -> None:
        self.chunks: list[Chunk] = []
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.custom: dict[str, str] = {}
        self.statistics: Statistics | None = None
        self.footer: Footer | None = None
        self.data_end: int | None = None
        self.data_crc = 0
        self.end = len(MAGIC)
        self.damage: list[Damage] = []
        self._data = data
        self._loose = False
        for opcode, start, stop in walk(data, len(MAGIC), len(data)):
            try:
                self._visit(opcode, start, stop)
            except Damage as damage:
                self.damage.append(damage)
            self.end = stop
            if opcode == Opcode.FOOTER:
                break
        if self._loose:
            data_end = self.end if self.data_end is None else self.data_end
            self.chunks.append(Chunk("", data_end - len(MAGIC), 0, len(MAGIC), data_end, {}))

    def _visit(self, opcode: int, start: int, stop: int) -> None:
        if opcode == Opcode.MESSAGE_INDEX:
            self._message_index(start, stop)
        elif opcode == Opcode.CHUNK:
            self.chunks.append(self._chunk(start, stop))
        elif opcode == Opcode.MESSAGE:
            self._loose = True
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self.define(opcode, self._data, start, stop)
        elif opcode == Opcode.METADATA:
            self._metadata(parse(Metadata, self._data, start, stop))
        elif opcode == Opcode.DATA_END:
            self.data_end = start - HEAD.size
            self.data_crc = parse(DataEnd, self._data, start, stop).data_section_crc
        elif opcode == Opcode.STATISTICS:
            self.statistics = parse(Statistics, self._data, start, stop)
        elif opcode == Opcode.FOOTER:
            self.footer = parse(Footer, self._data, start, stop)

    def define(self, opcode: int, data: mmap | bytes, start: int, stop: int) -> None:
        """Take up a schema or a channel.

        Raises:
            Damage: it cannot be read, or its number has another meaning already.
        """
        kind, known = (Schema, self.schemas) if opcode == Opcode.SCHEMA else (Channel, self.channels)
        record = parse(kind, data, start, stop)
        if known.setdefault(record.id, record) != record:
            raise Damage(f"{kind.__name__.lower()} {record.id} is defined twice, differently")

    def _chunk(self, start: int, stop: int) -> Chunk:
        try:
            _, _, size, crc = CHUNK_HEAD.unpack_from(self._data[start:stop])
            name_start = start + CHUNK_HEAD.size + 4
            name_stop = name_start + int.from_bytes(self._data[name_start - 4 : name_start], "little")
            compression = self._data[name_start:name_stop].decode()
        except (StructError, UnicodeDecodeError):
            raise Damage(f"the chunk at byte {start} has no header") from None
        packed = name_stop + 8
        if int.from_bytes(self._data[name_stop:packed], "little") != stop - packed:
            raise Damage(f"the chunk at byte {start} does not fill its record")
        return Chunk(compression, size, crc, packed, stop, {})

    def _message_index(self, start: int, stop: int) -> None:
        channel = int.from_bytes(self._data[start : start + 2], "little")
        if not self.chunks or (stop - start - 6) % 16:
            raise Damage(f"the message index at byte {start} fits no chunk")
        self.chunks[-1].indexes[channel] = (start + 6, stop)

    def _metadata(self, record: Metadata) -> None:
        if record.name == METADATA:
            self.custom = custom_data(record.metadata.get("serialized_metadata", ""))
