"""MCAP files with a record changed, and lengths, checksums and counts made right again.

Bytes changed at random end at the first checksum; a hostile file has right ones.
"""

from functools import lru_cache
from random import Random
from struct import Struct, error, pack
from typing import NamedTuple
from zlib import crc32

import zstandard

from . import plain
from .values import yaml_text

MAGIC = b"\x89MCAP0\r\n"
HEAD = Struct("<BQ")
CHUNK = Struct("<QQQII")
SCHEMA, CHANNEL, MESSAGE, CHUNK_CODE, INDEX, STATISTICS, METADATA, DATA_END, FOOTER = 3, 4, 5, 6, 7, 11, 12, 15, 2
CODES = (*range(1, 16), 0, 200)
MOST_UNPACKED = 1 << 20
BOMBS = (64 << 20, 64 << 20, 1 << 30)
KINDS = (4,) * 6 + (2, 2, 2, 2, 2, 1)
LENGTHS = (0, 1, 255, 2**31 - 1, 2**32 - 1, 2**40, 2**63, 2**64 - 1)


class Part(NamedTuple):
    """A record, and of a chunk also the records in it."""

    code: int
    content: bytes
    inner: "list[Part] | None" = None
    packing: str = ""


def mutate(data: bytes, other: bytes, rng: Random) -> bytes:
    """The file with one to three records changed; now and then only its bytes."""
    parts = parsed(data)
    if not parts or rng.random() < 0.1:
        return plain.mutate(data, other, rng)
    donors = parsed(other) or parts
    for _ in range(rng.choice((1, 1, 2, 3))):
        parts = _changed_list(parts, donors, rng)
    return framed(parts, rng, honest=rng.random() < 0.85)[: None if data.endswith(MAGIC) else -len(MAGIC)]


def parsed(data: bytes) -> list[Part]:
    """The records of a file, of chunks those in them; empty where it is none."""
    return _records(data[len(MAGIC) :], top=True) if data.startswith(MAGIC) else []


def _records(data: bytes, *, top: bool) -> list[Part]:
    parts, at = list[Part](), 0
    while len(data) - at >= HEAD.size:
        code, length = HEAD.unpack_from(data, at)
        at += HEAD.size
        if length > len(data) - at:
            break
        content = data[at : at + length]
        parts.append((_chunk(content) if code == CHUNK_CODE and top else None) or Part(code, content))
        at += length
        if top and code == FOOTER:
            break
    return parts


def _chunk(content: bytes) -> Part | None:
    try:
        size, name = CHUNK.unpack_from(content)[2], CHUNK.unpack_from(content)[4]
        packing = content[CHUNK.size : CHUNK.size + name].decode()
        packed = content[CHUNK.size + name + 8 :]
        if size > MOST_UNPACKED:
            return None
        if packing == "zstd":
            packed = zstandard.ZstdDecompressor().decompress(packed, max_output_size=MOST_UNPACKED)
        elif packing:
            return None
    except (error, UnicodeDecodeError, zstandard.ZstdError):
        return None
    return Part(CHUNK_CODE, b"", _records(packed, top=False), packing)


def _changed_list(parts: list[Part], donors: list[Part], rng: Random) -> list[Part]:
    parts = list(parts)
    if not parts:
        return [rng.choice(donors)]
    at, kind = rng.randrange(len(parts)), rng.choices(range(12), KINDS)[0]
    part = parts[at]
    if part.inner is not None and kind < 8:
        parts[at] = part._replace(inner=_changed_list(part.inner, _inner_of(donors, rng), rng))
    elif kind < 6:
        parts[at] = _changed(part, rng)
    elif kind == 6:
        del parts[at]
    elif kind == 7:
        parts[at:at] = [part] * rng.choice((1, 1, 50))
    elif kind == 8:
        parts.insert(rng.randrange(len(parts) + 1), parts.pop(at))
    elif kind == 9:
        parts.insert(at, rng.choice(donors))
    elif kind == 10:
        parts[at] = part._replace(code=rng.choice(CODES), inner=None) if part.inner is None else _repacked(part, rng)
    else:
        parts.insert(at, Part(CHUNK_CODE, bomb(rng.choice(BOMBS), rng.choice((None, *LENGTHS)))))
    return parts


def _inner_of(parts: list[Part], rng: Random) -> list[Part]:
    chunks = [part.inner for part in parts if part.inner]
    return rng.choice(chunks) if chunks else parts


def _repacked(part: Part, rng: Random) -> Part:
    return part._replace(packing=rng.choice(("", "zstd", "lz4", "bz2", "\0")))


def _changed(part: Part, rng: Random) -> Part:
    """A record with one of its fields changed."""
    content = part.content
    if part.code == MESSAGE and rng.random() < 0.6:
        head = bytearray(content[:22])
        at, size = rng.choice(((0, 2), (2, 4), (6, 8), (14, 8)))
        head[at : at + size] = rng.choice((*plain.NUMBERS, 3, 4, 5, 99)).to_bytes(9, "little")[:size]
        return part._replace(content=bytes(head) + content[22:])
    if strings := list(_strings(content)):
        start, length = rng.choice(strings)
        text = content[start : start + length]
        change = yaml_text if b": " in text else plain.mutate
        new = change(text, text, rng)
        if rng.random() < 0.9:  # with its right length
            return part._replace(content=content[: start - 4] + pack("<I", len(new)) + new + content[start + length :])
    return part._replace(content=plain.mutate(content, content, rng))


def _strings(content: bytes) -> list[tuple[int, int]]:
    """What looks like a text behind its length: start and length."""
    found = []
    for at in range(min(len(content) - 4, 4000)):
        length = int.from_bytes(content[at : at + 4], "little")
        text = content[at + 4 : at + 4 + length]
        if (
            2 <= length <= len(content) - at - 4
            and text.isascii()
            and (text.replace(b"\n", b"").decode().isprintable())
        ):
            found.append((at + 4, length))
    return found


@lru_cache(16)
def _zeros(size: int) -> bytes:
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    block = bytes(1 << 20)
    return b"".join([packer.compress(block) for _ in range(size >> 20)]) + packer.flush()


def bomb(size: int, claim: int | None) -> bytes:
    """A chunk of very many zeros, with any size in its head."""
    packed = _zeros(size)
    claimed = size if claim is None else claim
    return CHUNK.pack(0, 0, claimed, 0, 4) + b"zstd" + pack("<Q", len(packed)) + packed


def framed(parts: list[Part], rng: Random, *, honest: bool = True) -> bytes:
    """The file of records; where it is not honest, one length or checksum is wrong."""
    lie = rng.choice(("length", "chunk", "data", "summary", "size")) if not honest else ""
    data, data_end, liar = bytearray(MAGIC), None, rng.randrange(len(parts)) if parts else 0
    for number, part in enumerate(parts):
        content, lies = part.content, number == liar
        if part.inner is not None:
            content = _packed(part, lie if lies else "")
        if part.code == DATA_END and len(content) == 4:
            data_end = len(data)
            content = pack("<I", crc32(data) if lie != "data" else 1)
        if part.code == FOOTER and len(content) == 20:
            start = (data_end or 0) + HEAD.size + 4
            head = HEAD.pack(FOOTER, 20) + content[:16]
            content = content[:16] + pack("<I", crc32(bytes(data[start:]) + head) if lie != "summary" else 1)
        length = len(content) if not (lies and lie == "length") else rng.choice(LENGTHS)
        data += HEAD.pack(part.code, length) + content
    return bytes(data + MAGIC)


def _packed(part: Part, lie: str) -> bytes:
    block = b"".join(HEAD.pack(each.code, len(each.content)) + each.content for each in part.inner or [])
    packed = zstandard.ZstdCompressor(level=1).compress(block) if part.packing == "zstd" else block
    name = part.packing.encode()
    size, crc = (2**40 if lie == "size" else len(block)), (1 if lie == "chunk" else crc32(block))
    return CHUNK.pack(0, 2**40, size, crc, len(name)) + name + pack("<Q", len(packed)) + packed
