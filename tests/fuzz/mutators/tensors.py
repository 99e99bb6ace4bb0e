"""Safetensors files with a value of the header changed, its length made right, or numbers among the tensors changed."""

import json
from random import Random
from struct import error, pack, unpack_from

from . import plain
from .objects import json_text

FLOATS = (float("nan"), float("inf"), 1e38, -1e38, 0.0)


def mutate(data: bytes, other: bytes, rng: Random) -> bytes:
    header, tensors = _parts(data)
    if not header or rng.random() < 0.1:
        return plain.mutate(data, other, rng)
    if rng.random() < 0.75:
        header = json_text(header, _parts(other)[0] or header, rng)
    elif len(tensors) >= 4:
        at = 4 * rng.randrange(len(tensors) // 4)
        tensors = tensors[:at] + pack("<f", rng.choice(FLOATS)) + tensors[at + 4 :]
    return pack("<Q", len(header)) + header + tensors


def _parts(data: bytes) -> tuple[bytes, bytes]:
    try:
        (length,) = unpack_from("<Q", data)
        header = data[8 : 8 + length]
        json.loads(header)
    except (error, ValueError, RecursionError, OverflowError):
        return b"", b""
    return header, data[8 + length :]
