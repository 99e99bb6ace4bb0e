"""JSON and YAML texts with one value changed, or, where they are none (any more), with a part of the text changed."""

import json
from random import Random
from typing import Any

import yaml
from rled_msgs_py.errors import RledError
from rled_msgs_py.untrusted import read_json, read_yaml

from . import plain
from .values import mutated

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
    return _read(data, read_json)


def _yaml(data: bytes) -> Any:
    return _read(data, read_yaml)


def _read(data: bytes, read: Any) -> Any:
    try:
        return read(data.decode(), "an input") if len(data) < MOST else None
    except (RledError, UnicodeDecodeError):
        return None
