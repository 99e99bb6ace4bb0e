"""Serialized messages, and sqlite3 files of them, with one value changed and the rest kept sound."""

import sqlite3
from contextlib import closing
from itertools import count
from random import Random
from struct import pack

from . import plain
from .values import yaml_text

DOUBLES = (float("nan"), float("inf"), -float("inf"), 0.0, -0.0, 1e308, 5e-324, 1e-3)
TEXTS = (
    b"",
    b"nan",
    b"1e999",
    b"-1",
    b"9" * 30,
    b"shoulder",
    b"elbow",
    b"x" * 3000,
    b"\xff",
    b"agent: ",
    b"\0",
    b"{" * 99,
)
ALIGNED = 4


def mutate_cdr(data: bytes, other: bytes, rng: Random) -> bytes:
    """One field changed; the head (encoding) is left alone most of the time."""
    change = rng.choice((_word, _double, _text, _text, _lines, plain.mutate, plain.mutate))
    if len(data) < 12:
        return plain.mutate(data, other, rng)
    return change(data, other, rng)


def _place(data: bytes, rng: Random, size: int) -> int:
    return 4 + ALIGNED * rng.randrange(max(1, (len(data) - 4 - size) // ALIGNED + 1))


def _word(data: bytes, _: bytes, rng: Random) -> bytes:
    at = _place(data, rng, 4)
    return data[:at] + pack("<I", rng.choice(plain.NUMBERS) & 0xFFFFFFFF) + data[at + 4 :]


def _double(data: bytes, _: bytes, rng: Random) -> bytes:
    at = _place(data, rng, 8)
    return data[:at] + pack("<d", rng.choice(DOUBLES)) + data[at + 8 :]


def _text(data: bytes, other: bytes, rng: Random) -> bytes:
    found = _strings(data)
    if not found:
        return plain.mutate(data, other, rng)
    start, length = rng.choice(found)
    text = data[start : start + length - 1]
    new = rng.choice((rng.choice(TEXTS), plain.mutate(text, text, rng))) + b"\0"
    rest = start + length + -length % ALIGNED
    return data[: start - 4] + pack("<I", len(new)) + new + bytes(-len(new) % ALIGNED) + data[rest:]


def _lines(data: bytes, other: bytes, rng: Random) -> bytes:
    """A few aligned words cut out, doubled, or taken from another message."""
    at, size = _place(data, rng, 4), ALIGNED * rng.choice((1, 2, 4, 8))
    part = data[at : at + size]
    from_other = other[_place(other, rng, 4) :][:size] if len(other) > 12 else b""
    return data[:at] + rng.choice((b"", part + part, part * 100, from_other)) + data[at + size :]


def _strings(data: bytes) -> list[tuple[int, int]]:
    """Strings behind their length and with a zero at their end: start and length."""
    found = []
    for at in range(4, min(len(data) - 4, 4000), ALIGNED):
        length = int.from_bytes(data[at : at + 4], "little")
        if (
            1 <= length <= len(data) - at - 4
            and data[at + 3 + length] == 0
            and b"\0" not in data[at + 4 : at + 3 + length]
        ):
            found.append((at + 4, length))
    return found


# sqlite3 files with a value, a row or a table changed by SQL, so that the file stays a sound one; or their bytes.


VALUES = (
    None,
    0,
    -1,
    2**63 - 1,
    -(2**63),
    1.5,
    float("inf"),
    "",
    "x" * 3000,
    "\0",
    b"",
    b"\xff" * 40,
    "sensor_msgs/msg/None",
)

STEPS = 100
"""Thousands of instructions of SQLite's machine."""


def mutate_sqlite(data: bytes, other: bytes, rng: Random) -> bytes:
    if rng.random() < 0.3:
        return plain.mutate(data, other, rng)
    try:
        with closing(sqlite3.connect(":memory:")) as base:
            base.deserialize(data)
            steps = count()
            base.set_progress_handler(lambda: next(steps) > STEPS, 1000)  # a broken tree may have no end
            _change(base, rng)
            base.commit()
            return base.serialize()
    except (sqlite3.Error, UnicodeError, OverflowError):  # no sound one any more
        return plain.mutate(data, other, rng)


def _change(base: sqlite3.Connection, rng: Random) -> None:
    tables = [name for (name,) in base.execute("select name from sqlite_master where type = 'table'")]
    table = rng.choice(tables)
    columns = [row[1] for row in base.execute(f"pragma table_info({table})")]
    column, kind = rng.choice(columns), rng.randrange(8)
    (row,) = base.execute(f"select rowid from {table} order by random() limit 1").fetchone() or (1,)
    if kind == 0:
        base.execute(f"delete from {table} where rowid = ?", (row,))
    elif kind == 1:
        base.execute(f"drop table {table}")
    elif kind == 2:
        base.execute(f"alter table {table} drop column {column}")
    elif kind == 3:
        base.execute(f"alter table {table} rename column {column} to {column}_")
    elif kind == 4:
        base.execute(f"update {table} set {column} = ?", (rng.choice(VALUES),))
    else:
        (value,) = base.execute(f"select {column} from {table} where rowid = ?", (row,)).fetchone() or (None,)
        base.execute(f"update {table} set {column} = ? where rowid = ?", (_changed(value, rng), row))


def _changed(value: object, rng: Random) -> object:
    if isinstance(value, bytes) and value and rng.random() < 0.8:
        return mutate_cdr(value, value, rng)
    if isinstance(value, str) and value and rng.random() < 0.7:
        text = value.encode(errors="replace")
        return (yaml_text if "\n" in value else plain.mutate)(text, text, rng).decode(errors="replace")
    return rng.choice(VALUES)
