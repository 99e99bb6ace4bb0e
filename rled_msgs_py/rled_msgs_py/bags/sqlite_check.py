"""What a sqlite3 bag may consist of: plain tables, whose content is in the file.

A view, a virtual table or a computed column makes rows of any number and size out of nothing.
"""

import sqlite3
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from rled_msgs_py.bags.error import BagError
from rled_msgs_py.errors import ContractError
from rled_msgs_py.untrusted import read_yaml

TABLES = ("schema", "metadata", "topics", "message_definitions", "messages")
MAX_ROWS = 5000
"""Topics, and message definitions."""


def require_plain(path: Path) -> None:
    """Check a file before its rows are read.

    Raises:
        BagError: it has tables that recorders do not write, or texts beyond measure.
        sqlite3.Error: it is damaged.
    """
    with closing(sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1", uri=True)) as file:
        named = f"SELECT lower(name), type, coalesce(sql, '') FROM sqlite_master WHERE lower(name) IN {TABLES}"
        there = list[str]()
        for name, kind, sql in file.execute(named):
            if kind != "table" or "virtual" in sql[:40].lower():
                raise _unknown(path, f"no plain table '{name}'")
            there.append(name)
        for name in there:
            if any(hidden for *_, hidden in file.execute(f"PRAGMA table_xinfo({name})")):
                raise _unknown(path, f"a computed column in '{name}'")
        for name in {"topics", "message_definitions"} & set(there):
            if file.execute(f"SELECT count(*) FROM {name}").fetchone()[0] > MAX_ROWS:
                raise _unknown(path, f"more than {MAX_ROWS} {name}")
        if any(name == "offered_qos_profiles" for _, name, *_ in file.execute("PRAGMA table_info(topics)")):
            for (text,) in file.execute("SELECT DISTINCT offered_qos_profiles FROM topics"):
                _require_yaml(path, text)


def _require_yaml(path: Path, text: object) -> None:
    try:
        read_yaml(str(text), "the quality of service")
    except ContractError as error:
        raise BagError(f"{path} is damaged: {error.what}", error.accepted) from None


def _unknown(path: Path, what: str) -> BagError:
    return BagError(f"{path} has {what}", "the tables that rosbag2 writes")
