"""Messages that nobody should send: any value in any field of any class, near misses, and bytes that are no message."""

import importlib
import json
import math
import re
from typing import Any

from hypothesis import strategies as st
from rclpy.serialization import serialize_message

WORDS = st.sampled_from(
    [
        "",
        "shoulder",
        "elbow",
        "panda_joint1",
        "world",
        "task",
        "refused",
        "1",
        "-1",
        "nan",
        "1e999",
        "9" * 20,
        "x" * 3000,
        "\0",
    ]
)
TEXTS = st.one_of(WORDS, st.text(st.characters(exclude_categories=["Cs"]), max_size=20))
DOUBLES = st.one_of(st.sampled_from([math.nan, math.inf, -math.inf, 0.0, -0.0, 1e308, -1e308, 5e-324]), st.floats())
BITS = {"int8": 7, "int16": 15, "int32": 31, "int64": 63, "uint8": 8, "uint16": 16, "uint32": 32, "uint64": 64}
SEQUENCE = re.compile(r"sequence<(.+?)(?:, \d+)?>$")
ARRAY = re.compile(r"(.+)\[(\d+)\]$")
QUOTED = re.compile(r'"[^"]*"')
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.sampled_from([10**400, -1, 2**63]), DOUBLES, TEXTS),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(WORDS, inner, max_size=3)),
    max_leaves=6,
)


def hostile(message: type) -> st.SearchStrategy[Any]:
    """Any message of a class, whatever its fields are for."""
    fields = message.get_fields_and_field_types()  # type: ignore[attr-defined]
    return st.fixed_dictionaries({name: _values(kind) for name, kind in fields.items()}).map(
        lambda values: message(**values)
    )


def near_miss(message: Any) -> st.SearchStrategy[Any]:
    """A message like a valid one, but for one field, or a part of it."""
    fields = type(message).get_fields_and_field_types()

    def changed(name: str) -> st.SearchStrategy[Any]:
        value = getattr(message, name)
        return st.one_of(_values(fields[name]), *_nearly(value, fields[name])).map(
            lambda other: type(message)(**{each: getattr(message, each) for each in fields} | {name: other})
        )

    return st.sampled_from(sorted(fields)).flatmap(changed)


def near_text(text: str) -> st.SearchStrategy[str]:
    """A text like a valid one: JSON with one value changed, or a URDF with one attribute changed."""
    if text.startswith("{"):
        return _near_object(json.loads(text)).map(json.dumps)
    places = [found.span() for found in QUOTED.finditer(text)]
    words = st.one_of(TEXTS, st.sampled_from(["1e308 0 0", "0 0 nan", "1 2", "prismatic", "revolute", "base", "tip"]))
    return st.tuples(st.sampled_from(places), words).map(
        lambda each: f'{text[: each[0][0]]}"{each[1]}"{text[each[0][1] :]}'
    )


def garbage(message: Any) -> st.SearchStrategy[bytes]:
    """Bytes of a broken sender: a message cut short, one with a byte changed, or nothing like it."""
    data = bytes(serialize_message(message))
    places, values = st.integers(0, len(data) - 1), st.integers(0, 255)
    return st.one_of(
        places.map(lambda end: data[:end]),
        st.tuples(places, values).map(lambda each: data[: each[0]] + bytes([each[1]]) + data[each[0] + 1 :]),
        st.binary(max_size=200),
    )


def attacks(message: Any) -> st.SearchStrategy[Any]:
    """All of these, for one valid message of its class."""
    text = getattr(message, "data", None)
    texts = [near_text(text).map(lambda other: type(message)(data=other))] if isinstance(text, str) else []
    return st.one_of(hostile(type(message)), near_miss(message), garbage(message), *texts)


def _near_object(values: dict[str, Any]) -> st.SearchStrategy[dict[str, Any]]:
    def changed(name: str) -> st.SearchStrategy[dict[str, Any]]:
        nested = [_near_object(values[name])] if isinstance(values[name], dict) else []
        return st.one_of(JSON, *nested).map(lambda other: values | {name: other})

    return st.sampled_from(sorted(values)).flatmap(changed)


def _nearly(value: Any, kind: str) -> list[st.SearchStrategy[Any]]:
    """What is like the value of a field but for a part of it, if it has parts."""
    if hasattr(value, "get_fields_and_field_types"):
        return [near_miss(value)]
    if not (found := SEQUENCE.match(kind)) or not len(value):
        return []
    parts, part = list(value), found[1]

    def changed(place: int) -> st.SearchStrategy[list[Any]]:
        others = st.one_of(_values(part), *_nearly(parts[place], part))
        return others.map(lambda other: [*parts[:place], other, *parts[place + 1 :]])

    return [st.integers(0, len(parts) - 1).flatmap(changed)]


def _values(kind: str) -> st.SearchStrategy[Any]:
    if found := SEQUENCE.match(kind):
        return st.lists(_values(found[1]), max_size=9)
    if found := ARRAY.match(kind):
        return st.lists(_values(found[1]), min_size=int(found[2]), max_size=int(found[2]))
    if kind in BITS:
        low = -(2 ** BITS[kind]) if kind.startswith("int") else 0
        return st.one_of(st.sampled_from([low, 0, 2 ** BITS[kind] - 1]), st.integers(low, 2 ** BITS[kind] - 1))
    if "/" in kind:
        package, name = kind.split("/")
        return hostile(getattr(importlib.import_module(f"{package}.msg"), name))
    if kind.startswith(("string", "wstring")):
        return TEXTS
    floats = {"double": DOUBLES, "float": st.floats(width=32)}
    return (floats | {"boolean": st.booleans(), "octet": st.binary(min_size=1, max_size=1)})[kind]
