"""The records of an MCAP file one behind the other, also where the length of one is wrong."""

from collections.abc import Iterator, Mapping
from io import BytesIO
from mmap import mmap
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from rled_msgs_py.bags.mcap_chunks import chunk_end
from rled_msgs_py.bags.mcap_records import HEAD, MAGIC
from rled_msgs_py.bags.mcap_survey import INDEX_HEAD, PRIVATE

ENDS = (Opcode.DATA_END, Opcode.FOOTER)
TELLING: Mapping[Opcode, Any] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}
"""Records whose content tells where it ends."""
MAX_RECORD_LENGTH_READ = 1 << 20
"""Bytes that are looked at behind a record that says that it is shorter."""


def framed(data: mmap) -> Iterator[tuple[int, int, int]]:
    """The records up to the end of the data; where a wrong length leads astray, the next whole chunk follows."""
    at = len(MAGIC)
    while at < len(data):
        stop = _end(data, at)
        if stop is None:
            at = _next_chunk(data, at + 1)
        elif data[at] in ENDS:
            return
        else:
            yield data[at], at + HEAD.size, stop
            at = stop


def _end(data: mmap, at: int) -> int | None:
    """Where the record that begins at a byte ends; None where there is none.

    A wrong length leads into the middle of something, where what stands for an opcode and a length makes no sense. The
    content of most records tells their length too.
    """
    if not _begins_record(data, at):
        return None
    opcode, length = HEAD.unpack_from(data, at)
    start, said = at + HEAD.size, at + HEAD.size + length
    told = _told_end(data, opcode, start, said)
    for end in (told, said):
        if end is not None and start < end <= len(data) and _begins_record(data, end):
            return end
    return told if told == said or opcode == Opcode.CHUNK else None  # the file breaks off behind it


def _begins_record(data: mmap, at: int) -> bool:
    """Whether a whole record begins there, or the file ends."""
    if not 0 <= at <= len(data) - HEAD.size:
        return at == len(data)
    opcode, length = HEAD.unpack_from(data, at)
    if not (0 < opcode <= Opcode.DATA_END or opcode >= PRIVATE):
        return False
    start = at + HEAD.size
    return bool(length <= len(data) - start) or (opcode == Opcode.CHUNK and chunk_end(data, start) is not None)


def _told_end(data: mmap, opcode: int, start: int, said: int) -> int | None:
    """Where a record ends by its content, or else as it says; None where the content makes no sense."""
    if opcode == Opcode.CHUNK:
        return chunk_end(data, start)
    if opcode == Opcode.MESSAGE_INDEX and start + INDEX_HEAD.size <= len(data):
        return start + INDEX_HEAD.size + int(INDEX_HEAD.unpack_from(data, start)[1])
    if opcode not in TELLING:
        return said
    stream = ReadDataStream(BytesIO(data[start : max(said, start + MAX_RECORD_LENGTH_READ)]))
    try:
        TELLING[Opcode(opcode)].read(stream)
    except Exception:  # the library raises whatever broken bytes lead it to
        return None
    return start + int(stream.count)


def _next_chunk(data: mmap, at: int) -> int:
    """Where the next whole chunk begins; the end of the file if there is none."""
    while 0 <= (at := data.find(bytes([Opcode.CHUNK]), at)) <= len(data) - HEAD.size:
        start = at + HEAD.size
        if chunk_end(data, start) == start + HEAD.unpack_from(data, at)[1]:
            return at
        at += 1
    return len(data)
