"""sqlite3 files with a value, a row or a table changed by SQL, so that the file stays a sound one; or their bytes."""

import sqlite3
from contextlib import closing
from itertools import count
from random import Random

from . import cdr, plain
from .objects import yaml_text

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


def mutate(data: bytes, other: bytes, rng: Random) -> bytes:
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
        return cdr.mutate(value, value, rng)
    if isinstance(value, str) and value and rng.random() < 0.7:
        text = value.encode(errors="replace")
        return (yaml_text if "\n" in value else plain.mutate)(text, text, rng).decode(errors="replace")
    return rng.choice(VALUES)
