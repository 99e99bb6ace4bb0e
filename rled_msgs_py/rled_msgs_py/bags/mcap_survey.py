"""What an MCAP file holds, found record by record, so that an unfinished file can be read too.

Messages lie in chunks, and an index of its messages follows each chunk. ``DataEnd`` closes the data and carries their
checksum; the summary that follows repeats the definitions and counts the messages; the footer carries its checksum.
"""

from collections.abc import Callable, Mapping
from functools import partial
from mmap import mmap
from struct import Struct
from zlib import crc32

from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, Metadata, Statistics

from rled_msgs_py.bags.error import Damage
from rled_msgs_py.bags.mcap_chunks import Chunk, chunk_at
from rled_msgs_py.bags.mcap_records import HEAD, MAGIC, Definitions, parse, walk

CHANNEL = Struct("<H")
INDEX_HEAD_BYTES = 6
CRC_BYTES = 4
METADATA = "rosbag2"
"""Name of the metadata record in which rosbag2 repeats its ``metadata.yaml``."""


class Survey:
    """What a file holds, up to its footer or to the first record that is not whole.

    Attributes:
        chunks: in the order of the file; loose messages count as one more chunk without indexes.
        definitions: those outside the chunks; a finished file repeats all of them in its summary.
        information: YAML texts of the bag's metadata, the oldest first.
        statistics: counts of the summary, when there is one.
        data_end: where the data ends, when that is marked.
        is_ended: the file has its footer.
        end: where the last whole record ends.
        damage: what cannot be right.
    """

    def __init__(self, data: mmap | bytes) -> None:
        self.chunks: list[Chunk] = []
        self.definitions = Definitions()
        self.information: list[str] = []
        self.statistics: Statistics | None = None
        self.data_end: int | None = None
        self.is_ended = False
        self.end = len(MAGIC)
        self.damage: list[Damage] = []
        self._data = data
        self._data_crc = self._summary_crc = 0
        self._has_loose_messages = False
        self._visit_all()
        if self._has_loose_messages:
            data_end = self.end if self.data_end is None else self.data_end
            self.chunks.append(Chunk("", data_end - len(MAGIC), 0, len(MAGIC), data_end, {}))

    def has_right_data(self) -> bool:
        """Whether the data have their checksum, if one was computed."""
        return self._is_right(0, self.data_end or 0, self._data_crc)

    def has_right_summary(self) -> bool:
        """Whether the summary has its checksum, if one was computed; it reaches into the footer."""
        start = (self.data_end or 0) + HEAD.size + CRC_BYTES
        return self.is_ended and self._is_right(start, self.end - CRC_BYTES, self._summary_crc)

    def _is_right(self, start: int, stop: int, crc: int) -> bool:
        with memoryview(self._data) as whole, whole[start:stop] as part:
            return not crc or crc32(part) == crc

    def _visit_all(self) -> None:
        visitors: Mapping[int, Callable[[int, int], None]] = {
            int(Opcode.CHUNK): self._chunk,
            int(Opcode.MESSAGE): self._message,
            int(Opcode.SCHEMA): partial(self.definitions.take, Opcode.SCHEMA, self._data),
            int(Opcode.CHANNEL): partial(self.definitions.take, Opcode.CHANNEL, self._data),
            int(Opcode.METADATA): self._metadata,
            int(Opcode.DATA_END): self._data_ends,
            int(Opcode.STATISTICS): self._statistics,
            int(Opcode.FOOTER): self._footer,
        }
        message_index, chunks, channel_at = int(Opcode.MESSAGE_INDEX), self.chunks, CHANNEL.unpack_from
        for opcode, start, stop in walk(self._data, len(MAGIC), len(self._data)):
            if opcode == message_index and chunks and stop - start >= INDEX_HEAD_BYTES:
                # in a file of small chunks most records are these, so no call is made
                chunks[-1].indexes[channel_at(self._data, start)[0]] = (start + INDEX_HEAD_BYTES, stop)
            elif opcode in visitors:
                self._visit(visitors[opcode], start, stop)
            self.end = stop
            if self.is_ended:
                return

    def _visit(self, visitor: Callable[[int, int], None], start: int, stop: int) -> None:
        try:
            visitor(start, stop)
        except Damage as damage:
            self.damage.append(damage)

    def _chunk(self, start: int, stop: int) -> None:
        self.chunks.append(chunk_at(self._data, start, stop))

    def _message(self, *_: int) -> None:
        self._has_loose_messages = True

    def _metadata(self, start: int, stop: int) -> None:
        record = parse(Metadata, self._data, start, stop)
        if record.name == METADATA:
            self.information.append(record.metadata.get("serialized_metadata", ""))

    def _data_ends(self, start: int, stop: int) -> None:
        self.data_end = start - HEAD.size
        self._data_crc = parse(DataEnd, self._data, start, stop).data_section_crc

    def _statistics(self, start: int, stop: int) -> None:
        self.statistics = parse(Statistics, self._data, start, stop)

    def _footer(self, start: int, stop: int) -> None:
        self._summary_crc = parse(Footer, self._data, start, stop).summary_crc
        self.is_ended = True
