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
from mcap.records import DataEnd, Footer, Header, Metadata, Statistics

from rled_msgs_py.bags.error import Damage
from rled_msgs_py.bags.mcap_chunks import Chunk, chunk_at
from rled_msgs_py.bags.mcap_records import HEAD, MAGIC, Definitions, parse, walk

INDEX_HEAD = Struct("<HI")
"""Channel, and the bytes of its pairs of log time and offset, which follow."""
CRC_BYTES = 4
PRIVATE = 0x80
"""The first opcode that MCAP leaves to applications."""
LOOSE_BYTES = 4 << 20
"""Loose messages are put together to runs of about this size."""
METADATA = "rosbag2"
"""Name of the metadata record in which rosbag2 repeats its ``metadata.yaml``."""


class Survey:
    """What a file holds, up to its footer or to the first record that is not whole.

    Attributes:
        profile: what kind of recording the file says it is.
        chunks: in the order of the file; a run of loose messages counts as a chunk without indexes.
        definitions: those outside the chunks; a finished file repeats all of them in its summary.
        others: attachments, metadata of others and private records of the data: opcode, begin and end.
        information: YAML texts of the bag's metadata, the oldest first.
        statistics: counts of the summary, when there is one.
        data_end: where the data ends, when that is marked.
        is_ended: the file has its footer.
        end: where the last whole record ends.
        damage: what cannot be right.
    """

    def __init__(self, data: mmap | bytes) -> None:
        self.profile = ""
        self.chunks: list[Chunk] = []
        self.others: list[tuple[int, int, int]] = []
        self.definitions = Definitions()
        self.information: list[str] = []
        self.statistics: Statistics | None = None
        self.data_end: int | None = None
        self.is_ended = False
        self.end = len(MAGIC)
        self.damage: list[Damage] = []
        self._data = data
        self._data_crc = self._summary_crc = 0
        self._loose: tuple[int, int] | None = None
        self._visit_all()
        self._end_loose()

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
            int(Opcode.HEADER): self._header,
            int(Opcode.CHUNK): self._chunk,
            int(Opcode.MESSAGE): self._message,
            int(Opcode.SCHEMA): partial(self.definitions.take, Opcode.SCHEMA, self._data),
            int(Opcode.CHANNEL): partial(self.definitions.take, Opcode.CHANNEL, self._data),
            int(Opcode.METADATA): self._metadata,
            int(Opcode.ATTACHMENT): partial(self._other, Opcode.ATTACHMENT),
            int(Opcode.DATA_END): self._data_ends,
            int(Opcode.STATISTICS): self._statistics,
            int(Opcode.FOOTER): self._footer,
        }
        message_index, chunks, head_at = int(Opcode.MESSAGE_INDEX), self.chunks, INDEX_HEAD.unpack_from
        for opcode, start, stop in walk(self._data, len(MAGIC), len(self._data)):
            if opcode == message_index and chunks and stop - start >= INDEX_HEAD.size:
                # in a file of small chunks most records are these, so no call is made
                channel, length = head_at(self._data, start)
                begin = start + INDEX_HEAD.size
                chunks[-1].indexes[channel] = (begin, min(begin + length, stop))
            elif opcode in visitors:
                self._visit(visitors[opcode], start, stop)
            elif opcode >= PRIVATE:
                self._other(opcode, start, stop)
            self.end = stop
            if self.is_ended:
                return

    def _visit(self, visitor: Callable[[int, int], None], start: int, stop: int) -> None:
        try:
            visitor(start, stop)
        except Damage as damage:
            self.damage.append(damage)

    def _header(self, start: int, stop: int) -> None:
        self.profile = parse(Header, self._data, start, stop).profile

    def _chunk(self, start: int, stop: int) -> None:
        self._end_loose()
        self.chunks.append(chunk_at(self._data, start, stop))

    def _message(self, start: int, stop: int) -> None:
        if self._loose is None or start - self._loose[0] > LOOSE_BYTES:
            self._end_loose()
            self._loose = (start - HEAD.size, stop)
        self._loose = (self._loose[0], stop)

    def _end_loose(self) -> None:
        if self._loose:
            start, stop = self._loose
            self.chunks.append(Chunk("", stop - start, 0, start, stop, {}))
            self._loose = None

    def _other(self, opcode: int, start: int, stop: int) -> None:
        if self.data_end is None:
            self.others.append((opcode, start, stop))

    def _metadata(self, start: int, stop: int) -> None:
        record = parse(Metadata, self._data, start, stop)
        if record.name == METADATA:
            self.information.append(record.metadata.get("serialized_metadata", ""))
        else:
            self._other(Opcode.METADATA, start, stop)

    def _data_ends(self, start: int, stop: int) -> None:
        self.data_end = start - HEAD.size
        self._data_crc = parse(DataEnd, self._data, start, stop).data_section_crc

    def _statistics(self, start: int, stop: int) -> None:
        self.statistics = parse(Statistics, self._data, start, stop)

    def _footer(self, start: int, stop: int) -> None:
        self._summary_crc = parse(Footer, self._data, start, stop).summary_crc
        self.is_ended = True
