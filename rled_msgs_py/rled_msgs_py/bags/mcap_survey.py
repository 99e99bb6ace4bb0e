"""The records of an MCAP file, found by their framing alone, so that an unfinished file can be read too.

The format: magic, records, magic. A record is an opcode (1 byte), a length (8 bytes) and its content. Messages lie in
chunks, which are runs of records compressed as one; an index of its messages follows each chunk. ``DataEnd`` closes the
data and carries its checksum; the summary that follows repeats the definitions and counts the messages.
"""

import threading
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from io import BytesIO
from mmap import mmap
from struct import Struct
from typing import Any, NamedTuple
from zlib import crc32

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer, Metadata, Schema, Statistics

from rled_msgs_py.bags.error import Damage

MAGIC = b"\x89MCAP0\r\n"
HEAD = Struct("<BQ")
CHUNK_HEAD = Struct("<QQQII")
INDEX_HEAD = Struct("<HI")
PAIR_BYTES = 16
LENGTH = Struct("<Q")
LARGEST_CHUNK = 1 << 31
_THREAD = threading.local()
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
    if chunk.size > LARGEST_CHUNK:
        raise Damage(f"the chunk at byte {chunk.start} claims {chunk.size} bytes")
    try:
        records = _inflate(data[chunk.start : chunk.stop], chunk)
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise Damage(f"the chunk at byte {chunk.start} cannot be unpacked ({error})") from None
    if len(records) != chunk.size or (chunk.crc and crc32(records) != chunk.crc):
        raise Damage(f"the chunk at byte {chunk.start} fails its checksum")
    return records


def _inflate(packed: bytes, chunk: Chunk) -> bytes:
    if chunk.compression == "zstd":
        if zstandard.frame_content_size(packed) not in (-1, chunk.size):
            raise Damage(f"the chunk at byte {chunk.start} fails its checksum")
        return _zstd().decompress(packed, max_output_size=chunk.size)
    if chunk.compression == "lz4":
        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=chunk.size)
        return unpacked
    if chunk.compression:
        raise Damage(f"the chunk at byte {chunk.start} is packed by '{chunk.compression}', not by zstd or lz4")
    return packed


def _zstd() -> zstandard.ZstdDecompressor:
    # making one costs more than unpacking a small chunk, and one serves one thread
    if not hasattr(_THREAD, "zstd"):
        _THREAD.zstd = zstandard.ZstdDecompressor()
    made: zstandard.ZstdDecompressor = _THREAD.zstd
    return made


class Survey:
    """What a file holds, up to its footer or to the first record that is not whole.

    Attributes:
        chunks: in the order of the file; loose messages count as one more chunk without indexes.
        schemas: message definitions by number.
        channels: channels by number.
        information: YAML text of the bag's metadata, as rosbag2 repeats it in the file.
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
        self.information = ""
        self.statistics: Statistics | None = None
        self.footer: Footer | None = None
        self.data_end: int | None = None
        self.data_crc = 0
        self.end = len(MAGIC)
        self.damage: list[Damage] = []
        self._data = data
        self._loose = False
        self._visit_all()
        if self._loose:
            data_end = self.end if self.data_end is None else self.data_end
            self.chunks.append(Chunk("", data_end - len(MAGIC), 0, len(MAGIC), data_end, {}))

    def define(self, opcode: int, data: mmap | bytes, start: int, stop: int) -> None:
        """Take up a schema or a channel.

        Raises:
            Damage: it cannot be read, or its number has another meaning already.
        """
        kind, known = (Schema, self.schemas) if opcode == Opcode.SCHEMA else (Channel, self.channels)
        record = parse(kind, data, start, stop)
        if known.setdefault(record.id, record) != record:
            raise Damage(f"{kind.__name__.lower()} {record.id} is defined twice, differently")

    def _visit_all(self) -> None:
        visitors: Mapping[int, Callable[[int, int], None]] = {
            Opcode.MESSAGE_INDEX: self._message_index,
            Opcode.CHUNK: self._chunk,
            Opcode.MESSAGE: self._message,
            Opcode.SCHEMA: partial(self.define, Opcode.SCHEMA, self._data),
            Opcode.CHANNEL: partial(self.define, Opcode.CHANNEL, self._data),
            Opcode.METADATA: self._metadata,
            Opcode.DATA_END: self._data_end,
            Opcode.STATISTICS: self._statistics,
            Opcode.FOOTER: self._footer,
        }
        for opcode, start, stop in walk(self._data, len(MAGIC), len(self._data)):
            try:
                if opcode in visitors:
                    visitors[opcode](start, stop)
            except Damage as damage:
                self.damage.append(damage)
            self.end = stop
            if opcode == Opcode.FOOTER:
                return

    def _chunk(self, start: int, stop: int) -> None:
        if stop - start < CHUNK_HEAD.size + 8:
            raise Damage(f"the chunk at byte {start} has no head")
        _, _, size, crc, length = CHUNK_HEAD.unpack_from(self._data, start)
        name = start + CHUNK_HEAD.size
        packed = name + length + 8
        if packed > stop or LENGTH.unpack_from(self._data, packed - 8)[0] != stop - packed:
            raise Damage(f"the chunk at byte {start} does not fill its record")
        compression = self._data[name : name + length].decode(errors="replace")
        self.chunks.append(Chunk(compression, size, crc, packed, stop, {}))

    def _message_index(self, start: int, stop: int) -> None:
        if not self.chunks or (stop - start) % PAIR_BYTES != INDEX_HEAD.size:
            raise Damage(f"the message index at byte {start} fits no chunk")
        channel, _ = INDEX_HEAD.unpack_from(self._data, start)
        self.chunks[-1].indexes[channel] = (start + INDEX_HEAD.size, stop)

    def _message(self, *_: int) -> None:
        self._loose = True

    def _metadata(self, start: int, stop: int) -> None:
        record = parse(Metadata, self._data, start, stop)
        if record.name == METADATA:
            self.information = record.metadata.get("serialized_metadata", "")

    def _data_end(self, start: int, stop: int) -> None:
        self.data_end = start - HEAD.size
        self.data_crc = parse(DataEnd, self._data, start, stop).data_section_crc

    def _statistics(self, start: int, stop: int) -> None:
        self.statistics = parse(Statistics, self._data, start, stop)

    def _footer(self, start: int, stop: int) -> None:
        self.footer = parse(Footer, self._data, start, stop)
