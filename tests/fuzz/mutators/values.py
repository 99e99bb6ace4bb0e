"""Plain values (of JSON, YAML, MessagePack) with one of them changed, wherever it lies."""

import json
import math
from collections.abc import Iterator
from random import Random
from typing import Any

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
