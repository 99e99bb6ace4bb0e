"""The records of an MCAP file one behind the other, also where the length of one is wrong."""

from collections.abc import Iterator
from mmap import mmap

from mcap.opcode import Opcode

from rled_msgs_py.bags.error import Damage
from rled_msgs_py.bags.mcap_chunks import ZSTD, chunk_at
from rled_msgs_py.bags.mcap_records import HEAD, MAGIC
from rled_msgs_py.bags.mcap_survey import INDEX_HEAD, PRIVATE

ENDS = (Opcode.DATA_END, Opcode.FOOTER)
COMPRESSIONS = ("", "lz4", ZSTD)


def framed(data: mmap) -> Iterator[tuple[int, int, int]]:
    """The records up to the end of the data; where a wrong length leads astray, the next whole chunk follows."""
    at = len(MAGIC)
    while at < len(data):
        if not _begins_record(data, at):
            at = _next_chunk(data, at)
            continue
        opcode, length = HEAD.unpack_from(data, at)
        if opcode in ENDS:
            return
        start, stop = at + HEAD.size, at + HEAD.size + length
        yield opcode, start, stop
        at = _behind(data, opcode, start, stop)


def _behind(data: mmap, opcode: int, start: int, stop: int) -> int:
    """Where the next record begins.

    A wrong length leads into the middle of something, where what stands for an opcode and a length makes no sense. An
    index tells its own length too.
    """
    told, is_sound = stop, True
    if opcode == Opcode.MESSAGE_INDEX and start + INDEX_HEAD.size <= len(data):
        told = start + INDEX_HEAD.size + INDEX_HEAD.unpack_from(data, start)[1]
        is_sound = told == stop
    elif opcode == Opcode.CHUNK:
        is_sound = _is_whole_chunk(data, start, stop)
    found = next((each for each in (told, stop) if _begins_record(data, each)), None)
    return _next_chunk(data, stop if is_sound else start) if found is None else found


def _begins_record(data: mmap, at: int) -> bool:
    """Whether a whole record begins there, or the file ends."""
    if not 0 <= at <= len(data) - HEAD.size:
        return at == len(data)
    opcode, length = HEAD.unpack_from(data, at)
    return (0 < opcode <= Opcode.DATA_END or opcode >= PRIVATE) and bool(length <= len(data) - at - HEAD.size)


def _is_whole_chunk(data: mmap, start: int, stop: int) -> bool:
    try:
        return chunk_at(data, start, stop).compression in COMPRESSIONS
    except Damage:
        return False


def _next_chunk(data: mmap, at: int) -> int:
    """Where the next whole chunk begins; the end of the file if there is none."""
    while (at := data.find(bytes([Opcode.CHUNK]), at)) >= 0:
        begin = at + HEAD.size
        if _begins_record(data, at) and _is_whole_chunk(data, begin, begin + HEAD.unpack_from(data, at)[1]):
            return at
        at += 1
    return len(data)
