"""Texts of lines (CSV, HTTP heads, command lines) and of XML with one part of them changed."""

import re
from random import Random

from . import plain

WORDS = (
    b"nan",
    b"-1",
    b"1e999",
    b"true",
    b"--",
    b"-h",
    b"--ros-args",
    b"-p",
    b"x:=1",
    b"[",
    b"[::1",
    b"http://[",
    b"//",
    b"%zz",
)


def mutate_lines(data: bytes, other: bytes, rng: Random) -> bytes:
    lines, donors = data.split(b"\n"), other.split(b"\n")
    at, kind = rng.randrange(len(lines)), rng.randrange(7)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines[at:at] = lines[at : at + 1] * rng.choice((1, 2, 200))
    elif kind == 2:
        lines.insert(rng.randrange(len(lines)), lines.pop(at))
    elif kind == 3:
        lines.insert(at, rng.choice(donors))
    elif kind == 4:
        lines[at] = rng.choice(WORDS)
    elif kind == 5:
        key, mark, rest = lines[at].partition(rng.choice((b":", b",", b"=")))
        lines[at] = key + mark + rng.choice((rng.choice(WORDS), plain.mutate(rest, rest, rng)))
    else:
        lines[at] = plain.mutate(lines[at], rng.choice(donors), rng)
    return b"\n".join(lines)


# XML texts with an attribute, an element or the declaration changed.


QUOTED = re.compile(rb'"[^"]*"')
ELEMENT = re.compile(rb"<(\w+)[^<>]*/>|<(\w+)[^<>]*>[^<>]*</\2>")
TAG = re.compile(rb"<\w+")
XML_WORDS = (
    b"",
    b"nan",
    b"1e308 1e308 1e308",
    b"0 0 nan",
    b"0 0 0",
    b"1 2",
    b"1e-320 0 0",
    b"inf",
    b"prismatic",
    b"revolute",
    b"floating",
    b"mimic",
    b"world",
    b"tip",
    b"&#0;",
    b"&x9;",
    b"package://meshes/none.stl",
    b"file:///dev/zero",
    b"file:///etc/passwd",
    b"/proc/self/mem",
    b"http://127.0.0.1:1/x.stl",
    b"x" * 3000,
)
EXPANDING = (
    b"<!DOCTYPE r ["
    + b"".join(
        [b'<!ENTITY x0 "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx">']
        + [b'<!ENTITY x%d "%s">' % (k, b"&x%d;" % (k - 1) * 10) for k in range(1, 10)]
    )
    + b"]>"
)
EXTERNAL = b'<!DOCTYPE r [<!ENTITY x9 SYSTEM "file:///etc/passwd"><!ENTITY %% p SYSTEM "file:///dev/zero">]>'.replace(
    b"%%", b"%"
)
TAGS = (
    b"<joint",
    b"<link",
    b"<mesh",
    b"<origin",
    b"<limit",
    b"<mimic",
    b"<visual",
    b"<inertia",
    b"<robot",
    b"<axis",
    b"<box",
)


def mutate_xml(data: bytes, other: bytes, rng: Random) -> bytes:
    return rng.choice((_attribute, _attribute, _element, _element, _tag, _declaration, _deeper, plain.mutate))(
        data, other, rng
    )


def _attribute(data: bytes, other: bytes, rng: Random) -> bytes:
    if not (found := list(QUOTED.finditer(data))):
        return plain.mutate(data, other, rng)
    start, stop = rng.choice(found).span()
    others = [each[0] for each in QUOTED.finditer(other)] or [b'""']
    new = rng.choice((b'"%s"' % rng.choice(XML_WORDS), rng.choice(others)))
    return data[:start] + new + data[stop:]


def _element(data: bytes, other: bytes, rng: Random) -> bytes:
    """An element that holds no other gone, doubled, very often, or in another place."""
    if not (found := list(ELEMENT.finditer(data))):
        return plain.mutate(data, other, rng)
    start, stop = rng.choice(found).span()
    place = rng.choice(found).start()
    element, rest = data[start:stop], data[:start] + data[stop:]
    return rng.choice(
        (
            rest,
            data[:stop] + data[start:],
            data[:start] + element * 500 + data[stop:],
            rest[:place] + element + rest[place:],
        )
    )


def _tag(data: bytes, other: bytes, rng: Random) -> bytes:
    if not (found := list(TAG.finditer(data))):
        return plain.mutate(data, other, rng)
    start, stop = rng.choice(found).span()
    return data[:start] + rng.choice(TAGS) + data[stop:]


def _declaration(data: bytes, _: bytes, rng: Random) -> bytes:
    head = rng.choice(
        (EXPANDING, EXTERNAL, b'<?xml version="1.0" encoding="utf-7"?>', b'<?xml version="1.1"?>', b"\xff\xfe")
    )
    places = [each.end() - 1 for each in QUOTED.finditer(data)]
    if head[:2] == b"<!" and places:
        at = rng.choice(places)
        data = data[:at] + b"&x9;" + data[at:]
    return head + data


def _deeper(data: bytes, other: bytes, rng: Random) -> bytes:
    if not (found := list(ELEMENT.finditer(data))):
        return plain.mutate(data, other, rng)
    start, stop = rng.choice(found).span()
    times = rng.choice((1, 10, 5000))
    return data[:start] + b"<a>" * times + data[start:stop] + b"</a>" * times + data[stop:]
