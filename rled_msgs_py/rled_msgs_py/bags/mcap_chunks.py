"""The chunks of an MCAP file: runs of records packed as one, with a checksum."""

import threading
from collections.abc import Iterable
from mmap import mmap
from pathlib import Path
from struct import Struct
from typing import NamedTuple
from zlib import crc32

import lz4.frame
import zstandard
from mcap.opcode import Opcode

from rled_msgs_py.bags.error import Damage, ForeignBag, Oversized
from rled_msgs_py.bags.mcap_records import HEAD

CHUNK_HEAD = Struct("<QQQII")
LENGTH = Struct("<Q")
MAX_CHUNK = 1 << 30
"""Bytes of a chunk; recorders make chunks of some megabytes, few of some hundred."""
SMALL_CHUNK, SMALL_FILE = 16 << 20, 64 << 20
"""Bytes up to which a chunk, and all chunks of a file, may be packed as well as can be."""
CHUNK_RATIO, FILE_RATIO = 100, 500
"""How many times as large they may become beyond that; states and images of a camera become 2 to 50 times as large."""
ZSTD = "zstd"
COMPRESSIONS = (b"", b"lz4", ZSTD.encode())
ZSTD_OVERHEAD = HEAD.size + CHUNK_HEAD.size + len(ZSTD) + LENGTH.size
"""Bytes of a chunk's record beside its packed content."""
_THREAD = threading.local()


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


def chunk_at(data: mmap | bytes, start: int, stop: int) -> Chunk:
    """The chunk that is the content of a record.

    Raises:
        Damage: it is none.
    """
    if stop - start < CHUNK_HEAD.size + LENGTH.size:
        raise Damage(f"the chunk at byte {start} has no head")
    _, _, size, crc, length = CHUNK_HEAD.unpack_from(data, start)
    name = start + CHUNK_HEAD.size
    packed = name + length + LENGTH.size
    if packed > stop or LENGTH.unpack_from(data, packed - LENGTH.size)[0] != stop - packed:
        raise Damage(f"the chunk at byte {start} does not fill its record")
    return Chunk(data[name : name + length].decode(errors="replace"), size, crc, packed, stop, {})


def chunk_end(data: mmap | bytes, start: int) -> int | None:
    """Where a chunk ends whose record's content begins at ``start``, by its own lengths; None where there is none."""
    name = start + CHUNK_HEAD.size
    if name > len(data):
        return None
    packed = name + int(CHUNK_HEAD.unpack_from(data, start)[4]) + LENGTH.size
    if packed > len(data) or data[name : packed - LENGTH.size] not in COMPRESSIONS:
        return None
    end = packed + int(LENGTH.unpack_from(data, packed - LENGTH.size)[0])
    return end if end <= len(data) else None


def chunk_record(records: bytes | bytearray, first: int, last: int, packer: zstandard.ZstdCompressor | None) -> bytes:
    """A chunk as a record.

    Args:
        records: its content.
        first: minimum log time in it (ns).
        last: maximum log time in it (ns).
        packer: None leaves the content as it is, and so does one that makes it smaller than ``CHUNK_RATIO`` tells.
    """
    name, content = (ZSTD.encode(), packer.compress(records)) if packer else (b"", records)
    if len(records) > CHUNK_RATIO * len(content):  # no reader that bounds what it unpacks would take it
        name, content = b"", records
    head = CHUNK_HEAD.pack(first, last, len(records), crc32(records), len(name)) + name + LENGTH.pack(len(content))
    return b"".join((HEAD.pack(Opcode.CHUNK, len(head) + len(content)), head, content))


def require_measure(chunks: Iterable[Chunk], size: int, path: Path) -> None:
    """See that what is packed in a file is in proportion to it, before any of it is unpacked.

    Args:
        chunks: of the file.
        size: bytes of the file.
        path: its name, for the error.

    Raises:
        ForeignBag: it is not.
    """
    total, limit = sum(min(chunk.size, _limit(chunk)) for chunk in chunks), max(SMALL_FILE, FILE_RATIO * size)
    if total > limit:
        raise ForeignBag(f"{path} claims to hold {total} bytes in its {size}", f"{limit} bytes at limit")


def unpack(data: mmap | bytes, chunk: Chunk) -> bytes:
    """The records of a chunk.

    Raises:
        Oversized: they are out of proportion to what they are packed in.
        Damage: they cannot be unpacked, or their checksum differs.
    """
    where, limit = f"the chunk at byte {chunk.start}", _limit(chunk)
    packed = data[chunk.start : chunk.stop]
    try:
        if (claimed := _claimed(packed, chunk)) > limit:
            raise Oversized(f"{where} claims to hold {claimed} bytes in its {len(packed)}")
        records = _unpacked(packed, chunk, min(chunk.size, limit))
        if len(records) != chunk.size and chunk.crc:  # what has its checksum is right, whatever its size
            records = _unpacked(packed, chunk, limit)
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise Damage(f"{where} cannot be unpacked ({error})") from None
    if crc32(records) != chunk.crc if chunk.crc else len(records) != chunk.size:
        raise Damage(f"{where} fails its checksum")
    return records


def _claimed(packed: bytes, chunk: Chunk) -> int:
    """Bytes that unpacking would take; a frame of zstd may know better than the chunk, if there is a checksum."""
    claimed: int = zstandard.frame_content_size(packed) if chunk.compression == ZSTD else -1
    return claimed if claimed >= 0 and chunk.crc else max(claimed, chunk.size)


def _limit(chunk: Chunk) -> int:
    """Bytes that a chunk may have when it is unpacked."""
    return min(MAX_CHUNK, max(SMALL_CHUNK, CHUNK_RATIO * (chunk.stop - chunk.start)))


def _unpacked(packed: bytes, chunk: Chunk, limit: int) -> bytes:
    """The content of a chunk; where it is larger than ``limit`` bytes, so many at the limit, or nothing."""
    if chunk.compression == ZSTD:
        # a broken frame may claim any size, and would be given the memory
        return (
            _zstd().decompress(packed, max_output_size=limit) if zstandard.frame_content_size(packed) <= limit else b""
        )
    if chunk.compression == "lz4":
        records: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=limit)
        return records
    if chunk.compression:
        raise Damage(f"the chunk at byte {chunk.start} is packed by '{chunk.compression}', not by zstd or lz4")
    return packed


def _zstd() -> zstandard.ZstdDecompressor:
    # making one costs more than unpacking a small chunk, and one serves one thread
    if not hasattr(_THREAD, "zstd"):
        _THREAD.zstd = zstandard.ZstdDecompressor()
    made: zstandard.ZstdDecompressor = _THREAD.zstd
    return made
