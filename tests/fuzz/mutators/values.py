"""JSON, YAML, MessagePack and safetensors with one value changed somewhere, or a part of the bytes."""

import json
import math
from collections.abc import Iterator
from random import Random
from struct import error, pack, unpack_from
from typing import Any

import msgspec
import yaml
from rled_msgs_py.errors import RledError
from rled_msgs_py.untrusted import read_json, read_yaml

from . import plain

Path = tuple[Any, ...]

LEAVES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    -1,
    0.5,
    2**31,
    2**63,
    -(2**63),
    10**30,
    1e308,
    5e-324,
    math.nan,
    math.inf,
    -math.inf,
    "",
    "nan",
    "1e999",
    "-1",
    "x" * 3000,
    "9" * 500,
    "\0",
    "\ud800",
    "../../etc/passwd",
    "os:system",
    [],
    {},
    [[]],
    {"": None},
    [0] * 2000,
)


def mutated(values: Any, other: Any, rng: Random) -> Any:
    """A copy in which one value is another, is gone, is doubled, or lies deeper."""
    places = list(_paths(values))
    path = rng.choice(places)
    found = _at(values, path)
    if isinstance(found, str) and (inner := _inner(found)) is not None and rng.random() < 0.8:
        return _replaced(values, path, json.dumps(mutated(inner, inner, rng)))
    return _replaced(values, path, _changed(found, other, rng)) if rng.random() < 0.85 else _without(values, path)


def _changed(found: Any, other: Any, rng: Random) -> Any:
    kind = rng.randrange(6)
    if kind == 0:
        return _at(other, rng.choice(list(_paths(other))))
    if kind == 1 and isinstance(found, bool | int | float) and not isinstance(found, bool):
        return rng.choice((-found, found + 1, float(found), found * 1000, str(found), [found]))
    if kind == 2:
        for _ in range(rng.choice((1, 2, 30, 70, 200))):
            found = [found] if rng.random() < 0.5 else {"a": found}
        return found
    if kind == 3 and isinstance(found, list):
        return found * rng.choice((2, 3, 500)) if len(found) < 100 else found[:1]
    if kind == 4 and isinstance(found, dict):
        return {**found, rng.choice(("", "a", "hidden", "__class__", "type", "name")): rng.choice(LEAVES)}
    return rng.choice(LEAVES)


def _inner(text: str) -> Any:
    try:
        found = json.loads(text) if text[:1] in ("{", "[") and len(text) < 20_000 else None
    except (ValueError, RecursionError):
        return None
    return found or None


def _paths(values: Any, path: Path = ()) -> Iterator[Path]:
    yield path
    if len(path) > 40:
        return
    if isinstance(values, dict):
        for key, each in values.items():
            yield from _paths(each, (*path, key))
    elif isinstance(values, list):
        for k, each in enumerate(values[:50]):
            yield from _paths(each, (*path, k))


def _at(values: Any, path: Path) -> Any:
    for key in path:
        values = values[key]
    return values


def _replaced(values: Any, path: Path, value: Any) -> Any:
    if not path:
        return value
    key, rest = path[0], path[1:]
    if isinstance(values, dict):
        return {name: _replaced(each, rest, value) if name == key else each for name, each in values.items()}
    return [_replaced(each, rest, value) if k == key else each for k, each in enumerate(values)]


def _without(values: Any, path: Path) -> Any:
    if not path:
        return values
    key, rest = path[0], path[1:]
    if isinstance(values, dict):
        return {
            name: _without(each, rest) if name == key else each for name, each in values.items() if rest or name != key
        }
    return [_without(each, rest) if k == key else each for k, each in enumerate(values) if rest or k != key]


# JSON and YAML texts with one value changed, or, where they are none (any more), with a part of the text changed.


STRUCTURED = 0.75
MOST = 100_000


def json_text(data: bytes, other: bytes, rng: Random) -> bytes:
    values = _json(data) if rng.random() < STRUCTURED else None
    if values is None:
        return plain.mutate(data, other, rng)
    text = json.dumps(mutated(values, _json(other) or values, rng), ensure_ascii=rng.random() < 0.5)
    return text.encode(errors="surrogatepass")


def yaml_text(data: bytes, other: bytes, rng: Random) -> bytes:
    values = _yaml(data) if rng.random() < STRUCTURED else None
    if values is None:
        return plain.mutate(data, other, rng)
    try:
        text = yaml.safe_dump(mutated(values, _yaml(other) or values, rng), sort_keys=False, allow_unicode=True)
    except Exception:  # what was mutated before may hold what no dumper takes
        return plain.mutate(data, other, rng)
    return text.encode(errors="surrogatepass")


def _json(data: bytes) -> Any:
    return _text(data, read_json)


def _yaml(data: bytes) -> Any:
    return _text(data, read_yaml)


def _text(data: bytes, read: Any) -> Any:
    try:
        return read(data.decode(), "an input") if len(data) < MOST else None
    except (RledError, UnicodeDecodeError):
        return None


# MessagePack with one value changed, or its bytes.


def mutate_messagepack(data: bytes, other: bytes, rng: Random) -> bytes:
    values = _messagepack(data) if rng.random() < 0.8 else None
    if values is None:
        return plain.mutate(data, other, rng)
    try:
        return msgspec.msgpack.encode(mutated(values, _messagepack(other) or values, rng))
    except (OverflowError, RecursionError, UnicodeEncodeError, msgspec.MsgspecError):
        return plain.mutate(data, other, rng)


def _messagepack(data: bytes) -> Any:
    try:
        return msgspec.msgpack.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None


# Safetensors files with a value of the header changed, its length made right, or numbers among the tensors changed.


FLOATS = (float("nan"), float("inf"), 1e38, -1e38, 0.0)


def mutate_tensors(data: bytes, other: bytes, rng: Random) -> bytes:
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
