"""An MCAP file under recording: whatever kills its process, what was kept or flushed stays readable.

``keep`` hands a received message to the operating system at once, in a journal; ``add_message`` files it in the chunk
in progress. A chunk is closed when it has ``CHUNK_BYTES``, or by ``flush``. What the operating system has outlives the
process (a loss of power is another matter). Nothing here grows with the length of a recording: the index of the chunks,
which has to stand at the end of the file, waits in a file without a name.

``docs/architecture.md`` has the measurements that Zstandard and the size of a chunk were chosen by.
"""

import os
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import DataEnd, Header, Metadata, Statistics

from rled_msgs_py import __version__
from rled_msgs_py.bags.error import BagError, Damage, Unwritten, remedy
from rled_msgs_py.bags.holding import lock
from rled_msgs_py.bags.mcap_builder import ChunkBuilder
from rled_msgs_py.bags.mcap_journal import Journal
from rled_msgs_py.bags.mcap_output import Output
from rled_msgs_py.bags.mcap_records import HEAD, MAGIC, NO_SCHEMA, channel_of, packed, parse, schema_of, walk
from rled_msgs_py.bags.mcap_summary import index_of, summary
from rled_msgs_py.bags.mcap_survey import METADATA
from rled_msgs_py.bags.metadata import NO_TIME, FileSummary, serialized
from rled_msgs_py.bags.storage import BagTopic

LIBRARY = "rled "
"""What the header of a file begins with that this module has written."""
HEADER_BYTES = 256
"""Bytes that hold the header of a file of this module."""
CHUNK_BYTES = 256 << 10
PIECE = 1 << 20


def is_ours(path: Path) -> bool:
    """Whether a file was begun by this module, as far as it can be read."""
    try:
        if not path.is_file():  # a pipe would be waited for
            return False
        with path.open("rb") as file:
            begin = file.read(len(MAGIC) + HEAD.size + HEADER_BYTES)
        (_, start, stop), *_ = walk(begin, len(MAGIC), len(begin))
        library: str = parse(Header, begin, start, stop).library
    except (OSError, ValueError, Damage):
        return False
    return library.startswith(LIBRARY)


class McapWriter:
    """Writes one .mcap file.

    The file is held, so that nobody replaces or repairs it, until ``release``.

    Args:
        path: a file that is not there yet.
        custom: the user's metadata.
        profile: what kind of recording it is.

    Raises:
        BagError: another process took the file.
        Unwritten: (also from every method) the file cannot be written. It then holds what was safe before.
    """

    def __init__(self, path: Path, custom: Mapping[str, str], profile: str = "ros2") -> None:
        self.path = path
        self.custom = dict(custom)
        self._topics: list[BagTopic] = []
        self._schemas: dict[bytes, tuple[int, bytes]] = {}
        self._channels: list[bytes] = []
        self._counts: Counter[int] = Counter()
        self._first, self._last = NO_TIME, 0
        self._chunk, self._chunks = ChunkBuilder(), 0
        self._indexes = {Opcode.ATTACHMENT_INDEX: list[bytes](), Opcode.METADATA_INDEX: list[bytes]()}
        self._journal: Journal | None = None
        self._number = self._filed = self._safe = 0
        self._failure: BagError | None = None
        try:
            self._output = Output(path)
            self._chunk_index = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115  closed with the file
            self._held = lock(os.fdopen(os.dup(self._output.fileno()), "rb"), path)
        except OSError as error:
            raise BagError(f"{path} cannot be made: {error.strerror}") from None
        with self._guard():
            self._output.write(MAGIC + packed(Header(profile, f"{LIBRARY}{__version__}")))
            self._write_metadata()

    @property
    def failed(self) -> bool:
        """The file could not be written, so it stays unfinished."""
        return self._failure is not None

    def summary(self) -> FileSummary:
        """What the file holds."""
        counts = Counter[BagTopic]()
        for channel, topic in enumerate(self._topics, 1):
            counts[topic] += self._counts[channel]
        return FileSummary(self.path.name, self._first, self._last, counts)

    def add_topic(self, topic: BagTopic) -> int:
        """Announce a topic; returns the channel to write its messages to."""
        schema, definition = schema_of(topic, 0), b""
        number, schema_number = len(self._channels) + 1, 0
        if schema != NO_SCHEMA:
            key = packed(schema)
            if key not in self._schemas:
                definition = packed(schema_of(topic, len(self._schemas) + 1))
                self._schemas[key] = len(self._schemas) + 1, definition
            schema_number = self._schemas[key][0]
        self._channels.append(packed(channel_of(topic, number, schema_number)))
        self._topics.append(topic)
        self._chunk.define(definition + self._channels[-1])
        with self._guard():
            if self._journal:
                self._journal.define(definition + self._channels[-1])
        return number

    def keep(self, channel: int, log_time: int, data: bytes) -> int:
        """Make a message safe that has yet to find its place; returns its number for ``add_message``."""
        with self._guard():
            if self._journal is None:
                self._journal = Journal(self.path, b"".join(self._definitions()))
            self._journal.add(channel, self._number, log_time, data)
        self._number += 1
        return self._number - 1

    def forget(self, number: int) -> None:
        """A kept message is not to be filed."""
        if self._journal:
            self._journal.file(number)

    def add_message(
        self, channel: int, log_time: int, publish_time: int, data: bytes, number: int | None = None
    ) -> None:
        """File a message. One that was not kept is safe after the next ``flush``."""
        with self._guard():
            if number is None:
                number, self._number = self._number, self._number + 1
            elif self._journal:
                self._journal.file(number)
            self._chunk.add(channel, number, log_time, publish_time, data)
            self._counts[channel] += 1
            self._filed += 1
            self._first, self._last = min(self._first, log_time), max(self._last, log_time)
            if self._chunk.size >= CHUNK_BYTES:
                self._close_chunk()

    def add_record(self, opcode: int, content: bytes) -> None:
        """Write an attachment, metadata of others or a private record, as it lies in another file."""
        with self._guard():
            for kind, index in index_of(opcode, content, self._output.size):
                self._indexes[kind].append(index)
            self._output.write(HEAD.pack(opcode, len(content)) + content)

    def flush(self) -> None:
        """Close the chunk in progress: all that was written is safe."""
        with self._guard():
            self._close_chunk()

    def close(self) -> None:
        """Complete the file."""
        with self._guard():
            self._close_chunk()
            self._write_metadata()
            self._output.write(packed(DataEnd(self._output.crc)))
            for piece in summary(self._output.size, [*self._groups()]):
                self._output.write(piece)
            self._output.sync()
            self._end()
            if self._journal:
                self._journal.remove()

    def release(self) -> None:
        """Let others have the file."""
        self._held.close()

    def _definitions(self) -> Iterator[bytes]:
        yield from (record for _, record in self._schemas.values())
        yield from self._channels

    def _close_chunk(self) -> None:
        if not self._chunk.has_messages:
            return
        chunk, index = self._chunk.close(self._output.size)
        self._chunk_index.write(index)
        self._output.write(chunk)
        self._chunks += 1
        self._safe = self._filed
        if self._journal:
            self._journal.renew()

    def _write_metadata(self) -> None:
        content = {"serialized_metadata": serialized([self.summary()], self.custom)}
        self.add_record(Opcode.METADATA, packed(Metadata(METADATA, content))[HEAD.size :])

    def _groups(self) -> Iterator[tuple[Opcode, Iterator[bytes]]]:
        """The records of the summary."""
        statistics = Statistics(
            attachment_count=len(self._indexes[Opcode.ATTACHMENT_INDEX]),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=self._chunks,
            message_count=self._filed,
            message_end_time=self._last,
            message_start_time=self._first if self._filed else 0,
            metadata_count=len(self._indexes[Opcode.METADATA_INDEX]),
            schema_count=len(self._schemas),
        )
        self._chunk_index.seek(0)
        yield Opcode.SCHEMA, iter([record for _, record in self._schemas.values()])
        yield Opcode.CHANNEL, iter(self._channels)
        yield Opcode.STATISTICS, iter([packed(statistics)])
        yield Opcode.CHUNK_INDEX, iter(lambda: self._chunk_index.read(PIECE), b"")
        for opcode, indexes in self._indexes.items():
            yield opcode, iter(indexes)

    def _end(self) -> None:
        self._output.close()
        self._chunk_index.close()

    @contextmanager
    def _guard(self) -> Iterator[None]:
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except OSError as error:
            kept = self._safe + (self._journal.count if self._journal else 0)
            what = f"writing {self.path} failed: {error.strerror}; kept: the first {kept} messages"
            self._failure = Unwritten(what, "", f"free space, then {remedy(self.path.parent)}", error.strerror or "")
            with suppress(OSError):
                self._end()
                if self._journal:
                    self._journal.close()
            self.release()
            raise self._failure from error
