"""Proof that a file holds what another one does, or more, by a reader that shares no code with what wrote it."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from rled_msgs_py.bags.columns import payloads
from rled_msgs_py.bags.error import BagError
from rled_msgs_py.bags.mcap_chunks import Chunk as Packed
from rled_msgs_py.bags.mcap_chunks import unpack
from rled_msgs_py.bags.mcap_file import McapFile
from rled_msgs_py.bags.mcap_records import walk


class Content(NamedTuple):
    """What has to be the same of a message; times in ns."""

    topic: str
    log_time: int
    publish_time: int
    data: bytes


def require_all(original: Path, successor: Path) -> None:
    """See that a file holds every message that can be read of another one, in the same order.

    Raises:
        BagError: one is missing, or the successor cannot be read.
    """
    found = _contents(McapFile(successor))
    for wanted in read_by_the_mcap_library(original):
        if not any(wanted == each for each in found):  # goes on from where it was
            what = f"{original} cannot be repaired without losing a message on {wanted.topic}"
            raise BagError(f"{what} ({wanted.log_time} ns); it is as it was")


def _contents(file: McapFile) -> Iterator[Content]:
    for run in file.messages(file.topics):
        times = run.channel.tolist(), run.log_time.tolist(), run.publish_time.tolist()
        for channel, log_time, publish_time, data in zip(*times, payloads(run), strict=True):
            yield Content(file.topics[channel].name, log_time, publish_time, data)


def read_by_the_mcap_library(path: Path) -> Iterator[Content]:
    """The messages of the chunks that have their checksum, up to the first record that the library refuses."""
    channels = dict[int, Channel]()
    for record in _records(path):
        for each in _records_in(record) if isinstance(record, Chunk) else [record]:
            if isinstance(each, Channel):
                channels[each.id] = each
            elif isinstance(each, Message) and each.channel_id in channels:
                name = "/" + channels[each.channel_id].topic.lstrip("/")
                yield Content(name, _signed(each.log_time), _signed(each.publish_time), each.data)


def _records(path: Path) -> Iterator[McapRecord]:
    """The records of a file, without one that breaks off: the library would take what is there of it."""
    with path.open("rb") as file:
        limit = path.stat().st_size
        reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=limit)
        last: McapRecord | None = None
        try:
            for record in reader.records:
                if last is not None:
                    yield last
                last = record
        except Exception:  # the library raises whatever broken bytes lead it to
            return


def _records_in(chunk: Chunk) -> list[McapRecord]:
    packed = Packed(chunk.compression, chunk.uncompressed_size, chunk.uncompressed_crc, 0, len(chunk.data), {})
    try:
        block = unpack(chunk.data, packed)
        records: list[McapRecord] = breakup_chunk(replace(chunk, compression="", data=block))
    except Exception:  # the same
        return []
    end = max((stop for _, _, stop in walk(block, 0, len(block))), default=0)
    return records if end == len(block) else records[:-1]  # the library takes what is there of a torn one


def _signed(time: int) -> int:
    return (time + (1 << 63)) % (1 << 64) - (1 << 63)
