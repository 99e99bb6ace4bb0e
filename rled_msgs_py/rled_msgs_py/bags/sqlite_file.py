"""A sqlite3 file of an older recording as a storage of messages, read by rosbags.

Such a file has no checksums: what sqlite itself does not find broken is taken as it is.
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from rled_msgs_py.bags.definitions import definition, is_known
from rled_msgs_py.bags.error import BagError
from rled_msgs_py.bags.sqlite_check import require_plain
from rled_msgs_py.bags.storage import BagTopic, Messages

RUN_MESSAGES, RUN_BYTES = 10_000, 4 << 20
MAGIC = b"SQLite format 3\0"


class SqliteFile:
    """One .db3 file; a ``Storage``.

    Raises:
        BagError: the file is missing, foreign or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.custom: Mapping[str, str] = {}
        _require_sqlite(path)
        with _reported(path):
            require_plain(path)
        with self._open() as reader:
            found = {connection.id: connection for connection in reader.connections}
        self._connections: Mapping[int, Connection] = found
        self.counts: Mapping[int, int] = {number: each.msgcount for number, each in found.items()}
        with _reported(path):
            self.topics: Mapping[int, BagTopic] = {number: _topic(each) for number, each in found.items()}

    def messages(self, channels: Collection[int]) -> Iterator[Messages]:
        """Messages of some channels, in runs.

        Raises:
            BagError: the file is damaged.
        """
        wanted = [self._connections[channel] for channel in channels]
        if not wanted:
            return
        with self._open() as reader:
            rows, held = list[tuple[int, int, bytes]](), 0
            for connection, time, data in reader.messages(wanted):
                rows.append((connection.id, time, bytes(data)))
                held += len(data)
                if len(rows) == RUN_MESSAGES or held > RUN_BYTES:
                    yield _run(rows)
                    rows, held = [], 0
            if rows:
                yield _run(rows)

    @contextmanager
    def _open(self) -> Iterator[Any]:
        reader = Sqlite3Reader(self.path)
        try:
            with _reported(self.path):
                reader.open()
                yield reader
        finally:
            if reader.dbconn:
                reader.close()


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    try:
        yield
    except BagError:
        raise
    except Exception as error:  # rosbags and sqlite raise whatever a broken file leads them to
        reason = " ".join(str(error).split())
        raise BagError(f"{path} is damaged: {reason}", "a recorded .db3 file", "record it again") from None


def _require_sqlite(path: Path) -> None:
    try:
        if not path.is_file() and path.exists():  # a pipe would be waited for
            raise BagError(f"{path} is no regular file", "a .db3 file")
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
    except OSError as error:
        raise BagError(f"{path} cannot be read: {error.strerror}", "a .db3 file") from None
    if head != MAGIC:
        what = "is empty" if not head else "is no sqlite3 file"
        raise BagError(f"{path} {what}", "a rosbag2 recording in the storage 'sqlite3'", "record it again")


def _topic(connection: Connection) -> BagTopic:
    name, text, found = "/" + connection.topic.lstrip("/"), connection.msgdef.data, connection.digest
    if not text and is_known(connection.msgtype):
        # before version 4 a bag had no definitions; those of the common interfaces have not changed since
        text, found = definition(connection.msgtype)
    serialization = getattr(connection.ext, "serialization_format", "")
    return BagTopic(name, connection.msgtype, serialization, text, "ros2msg", found or "", "")


def _run(rows: list[tuple[int, int, bytes]]) -> Messages:
    channel, time, data = zip(*rows, strict=True)
    size = np.array([len(each) for each in data], np.int64)
    start = np.cumsum(size) - size
    times = np.array(time, np.int64)
    return Messages(b"".join(data), np.array(channel, np.int64), times, times, start, size)
