"""An MCAP file under recording: whatever kills its process, what was flushed stays readable.

``flush`` closes the chunk in progress and hands it to the operating system, which keeps it when the process dies (a
loss of power is another matter). The recorder calls it every ``FLUSH_PERIOD``, so the chunks are small. Measured with
100,000 messages of a Panda on five topics (19.1 MB), flushed after every 5, 12 and 100 messages and not at all:

- Zstandard: 17.4, 11.4, 7.0, 6.5 MB; 25, 13, 6, 6 µs of processor time a message
- LZ4: 19.6, 13.0, 8.6, 8.0 MB; 18, 12, 8, 5 µs
- unpacked: 28.8, 25.9, 24.1, 23.8 MB; 14, 10, 9, 8 µs

In real time, 250 messages a second, a flush every 25 ms closes chunks of 5 to 10 messages, in lockstep of 60 and more.
Zstandard is the smallest everywhere, and its time is small beside that of receiving a message.
"""

import fcntl
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from rled_msgs_py import __version__
from rled_msgs_py.bags.error import BagError, remedy
from rled_msgs_py.bags.mcap_survey import METADATA
from rled_msgs_py.bags.metadata import NO_TIME, FileSummary, serialized
from rled_msgs_py.bags.storage import BagTopic

FLUSH_PERIOD = 0.025
"""Seconds of recording that a killed process may lose."""

CHUNK_BYTES = 1 << 20


class _Output:
    """A file that is written without a buffer, so that nothing is left in the process after a failure."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        with suppress(OSError):  # a file system without locks
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._size = 0

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        os.fsync(self._file.fileno())
        self._file.close()

    def cut(self, size: int) -> None:
        """Close with the first ``size`` bytes only."""
        self._file.truncate(size)
        self._file.close()


class McapWriter:
    """Writes one .mcap file.

    Args:
        path: a file that is not there yet.
        custom: the user's metadata.

    Raises:
        BagError: (also from every method) the file cannot be written. It is then cut back to what was flushed before.
    """

    def __init__(self, path: Path, custom: Mapping[str, str]) -> None:
        self.path = path
        self.custom = dict(custom)
        self.counts: dict[BagTopic, int] = {}
        self._topics: list[BagTopic] = []
        self._schemas: dict[tuple[str, str], int] = {}
        self._first, self._last = NO_TIME, 0
        self._safe_bytes = self._safe_messages = 0
        self._failure: BagError | None = None
        try:
            self._output = _Output(path)
        except OSError as error:
            raise BagError(f"{path} cannot be made: {error.strerror}") from None
        with self._guard():
            self._writer = Writer(
                cast(IO[Any], self._output),
                chunk_size=CHUNK_BYTES,
                compression=CompressionType.ZSTD,
                enable_data_crcs=True,
            )
            self._writer.start(profile="ros2", library=f"rled {__version__}")
            self._write_metadata()

    @property
    def failed(self) -> bool:
        """The file could not be written, so it stays unfinished."""
        return self._failure is not None

    def summary(self) -> FileSummary:
        """What the file holds."""
        return FileSummary(self.path.name, self._first, self._last, self.counts)

    def add_topic(self, topic: BagTopic) -> int:
        """Announce a topic; returns the channel to write its messages to."""
        key = (topic.type, topic.definition)
        with self._guard():
            if key not in self._schemas:
                self._schemas[key] = self._writer.register_schema(
                    topic.type, topic.definition_encoding, topic.definition.encode()
                )
            details = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.hash}
            channel = self._writer.register_channel(topic.name, topic.encoding, self._schemas[key], details)
        self._topics.append(topic)
        self.counts.setdefault(topic, 0)
        return int(channel)

    def add_message(self, channel: int, log_time: int, publish_time: int, data: bytes) -> None:
        """Take a message; it is safe after the next ``flush``."""
        with self._guard():
            self._writer.add_message(channel, log_time, data, publish_time)
            self.counts[self._topics[channel - 1]] += 1
            self._first, self._last = min(self._first, log_time), max(self._last, log_time)

    def flush(self) -> None:
        """Make what was taken so far survive the end of this process."""
        with self._guard():
            self._writer.flush()

    def close(self) -> None:
        """Complete the file."""
        with self._guard():
            self._writer.flush()
            self._write_metadata()
            self._writer.finish()
            self._output.close()

    def _write_metadata(self) -> None:
        self._writer.add_metadata(METADATA, {"serialized_metadata": serialized([self.summary()], self.custom)})

    @contextmanager
    def _guard(self) -> Iterator[None]:
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except OSError as error:
            self._output.cut(self._safe_bytes)
            what = f"writing {self.path} failed: {error.strerror}; kept: the first {self._safe_messages} messages"
            self._failure = BagError(what, "", f"free space, then {remedy(self.path.parent)}")
            raise self._failure from error
        # between two calls the file holds whole chunks only, and a chunk ends with the newest message
        if self._output.tell() != self._safe_bytes:
            self._safe_bytes, self._safe_messages = self._output.tell(), sum(self.counts.values())
