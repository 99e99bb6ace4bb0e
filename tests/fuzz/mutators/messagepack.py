"""MessagePack with one value changed, or its bytes."""

from random import Random
from typing import Any

import msgspec

from . import plain
from .values import mutated


def mutate(data: bytes, other: bytes, rng: Random) -> bytes:
    values = _read(data) if rng.random() < 0.8 else None
    if values is None:
        return plain.mutate(data, other, rng)
    try:
        return msgspec.msgpack.encode(mutated(values, _read(other) or values, rng))
    except (OverflowError, RecursionError, UnicodeEncodeError, msgspec.MsgspecError):
        return plain.mutate(data, other, rng)


def _read(data: bytes) -> Any:
    try:
        return msgspec.msgpack.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
