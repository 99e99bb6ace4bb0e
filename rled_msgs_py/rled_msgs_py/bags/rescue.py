"""What is whole in an MCAP file and its journals, whatever has become of the rest."""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from mmap import mmap
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Statistics

from rled_msgs_py.bags.error import BagError, Damage, Oversized
from rled_msgs_py.bags.mcap_chunks import chunk_at, unpack
from rled_msgs_py.bags.mcap_file import map_file
from rled_msgs_py.bags.mcap_framing import ENDS, framed
from rled_msgs_py.bags.mcap_journal import journals_of
from rled_msgs_py.bags.mcap_records import HEAD, MAGIC, MESSAGE_HEAD, Definitions, parse, walk
from rled_msgs_py.bags.mcap_summary import CRC, FOOTER
from rled_msgs_py.bags.storage import BagTopic

TAIL = HEAD.size + FOOTER.size + CRC.size + len(MAGIC)
"""Bytes of a footer and the magic after it."""


class Rescued(NamedTuple):
    """A whole message.

    Attributes:
        number: MCAP's ``sequence``.
        topic: with everything that the file says of it.
        log_time: time of its arrival (ns).
        publish_time: time of its sending (ns).
        data: the message.
    """

    number: int
    topic: BagTopic
    log_time: int
    publish_time: int
    data: bytes


class Summary(NamedTuple):
    """What the end of a file says of it.

    Attributes:
        definitions: of all channels, if they are repeated there.
        chunks: where the record of each begins and ends.
        statistics: its counts, if there are any.
    """

    definitions: Definitions
    chunks: list[tuple[int, int]]
    statistics: Statistics | None


def summary_of(data: mmap) -> Summary:
    """Read the summary from the end of a file; an empty one where it is missing or not as it was written."""
    found, counts, chunks = Definitions(), None, list[tuple[int, int]]()
    try:
        for opcode, start, stop in _summary_records(data):
            found.take(opcode, data, start, stop)
            if opcode == Opcode.STATISTICS:
                counts = parse(Statistics, data, start, stop)
            elif opcode == Opcode.CHUNK_INDEX:
                index = parse(ChunkIndex, data, start, stop)
                chunks.append((index.chunk_start_offset, index.chunk_start_offset + index.chunk_length))
    except Damage:
        return Summary(Definitions(), [], None)
    return Summary(found, sorted(chunks), counts)


def _summary_records(data: mmap) -> Iterator[tuple[int, int, int]]:
    at = len(data) - TAIL
    if at < len(MAGIC) or data[-len(MAGIC) :] != MAGIC or HEAD.unpack_from(data, at)[0] != Opcode.FOOTER:
        return
    footer = parse(Footer, data, at + HEAD.size, len(data) - len(MAGIC))
    begin, end = footer.summary_start, len(data) - len(MAGIC) - CRC.size
    if len(MAGIC) < begin < at and (not footer.summary_crc or crc32(data[begin:end]) == footer.summary_crc):
        yield from walk(data, begin, at)


def rescued(data: mmap, lost: list[str]) -> Iterator[Rescued]:
    """The whole messages of a file, in its order.

    Args:
        data: the file.
        lost: what is not whole is added to it, in words.

    Raises:
        Oversized: a chunk is out of proportion to the file.
    """
    # definitions in a chunk are under its checksum, those of a summary are only as good as its own
    summary, unknown = summary_of(data), 0
    definitions = summary.definitions
    for opcode, block, start, stop in _records(data, summary, lost):
        try:
            definitions.take(opcode, block, start, stop, prevails=block is not data)
            if opcode == Opcode.MESSAGE and stop - start >= MESSAGE_HEAD.size:
                channel, number, log_time, publish_time = MESSAGE_HEAD.unpack_from(block, start)
                if channel not in definitions.channels:
                    unknown += 1
                    continue
                content = block[start + MESSAGE_HEAD.size : stop]
                yield Rescued(number, definitions.topic(channel), log_time, publish_time, content)
        except Damage as damage:
            lost.append(str(damage))
    if unknown:
        lost.append(f"{unknown} messages of which the topic is not known")


def _records(data: mmap, summary: Summary, lost: list[str]) -> Iterator[tuple[int, mmap | bytes, int, int]]:
    """The records of the data, those in chunks too: opcode, where they are, begin and end of the content."""
    for opcode, start, stop in _top_records(data, summary):
        if opcode != Opcode.CHUNK:
            yield opcode, data, start, stop
            continue
        try:
            chunk = chunk_at(data, start, stop)
            block, end = unpack(data, chunk), 0
        except Oversized:
            raise
        except Damage as damage:
            lost.append(str(damage))
            continue
        for inner, begin, end in walk(block, 0, len(block)):
            yield inner, block, begin, end
        if end != len(block):
            lost.append(f"{len(block) - end} bytes of the chunk at byte {chunk.start}, in which a record breaks off")


def _top_records(data: mmap, summary: Summary) -> Iterator[tuple[int, int, int]]:
    """The records outside chunks, and the chunks; where a wrong length leads astray, those that the summary knows."""
    known = deque(each for each in summary.chunks if _is_chunk(data, *each))
    for opcode, start, stop in framed(data):
        while known and known[0][0] < start - HEAD.size:
            yield _span(*known.popleft())
        if known and known[0][0] == start - HEAD.size:
            yield _span(*known.popleft())
        else:
            yield opcode, start, stop
    yield from (_span(*each) for each in known)


def _is_chunk(data: mmap, begin: int, end: int) -> bool:
    return len(MAGIC) <= begin < end - HEAD.size and end <= len(data) and data[begin] == Opcode.CHUNK


def _span(begin: int, end: int) -> tuple[int, int, int]:
    return Opcode.CHUNK, begin + HEAD.size, end


def journaled(file: Path, lost: list[str]) -> dict[int, Rescued]:
    """What the recorder of a file has kept beside it, by number, in the order of reception."""
    found = dict[int, Rescued]()
    for journal in filter(Path.exists, journals_of(file)):
        try:
            data = map_file(journal)
        except BagError as error:
            lost.append(error.what)
        else:
            lost += torn(data)
            with suppress(Oversized):  # no journal has such a chunk
                found |= {each.number: each for each in rescued(data, lost)}
    return dict(sorted(found.items()))


def torn(data: mmap) -> list[str]:
    """What to say of a file whose data break off within a record, or in which a length is wrong."""
    end, said = len(MAGIC), list[str]()
    for _, start, stop in framed(data):
        if start - HEAD.size != end:
            said.append(f"what lies before byte {start - HEAD.size}, where a record has a wrong length")
        end = stop
    if end < len(data) and data[end] not in ENDS:
        said.append(f"the last {len(data) - end} bytes, in which a record breaks off")
    return said


def in_order(received: Iterable[Rescued], last: int) -> Iterator[Rescued]:
    """Messages by log time, but those after a restart of the simulation after those before it.

    What was received before any stamp was known goes with the first stamp.

    Args:
        received: in the order of reception.
        last: log time before which none may lie (ns).
    """
    runs, newest = [list[Rescued]()], dict[BagTopic, int]()
    for message in received:
        if message.log_time < newest.get(message.topic, 0):
            runs.append([])
            newest.clear()
        newest[message.topic] = message.log_time
        runs[-1].append(message)
    last = max(last, min((each.log_time for each in runs[0] if each.log_time), default=0))
    for run in runs:
        for message in sorted(run, key=attrgetter("log_time")):
            last = max(last, message.log_time)
            yield message._replace(log_time=last)
