"""What a recorder has received and not yet filed, kept in a second file beside the first.

Messages are held until their order is known, and a chunk is worth closing only when it has some size. What is received
meanwhile would be lost with the process. So each message also goes into the journal at once, which is one write: the
operating system keeps it, whatever becomes of the process. The journal is an unfinished MCAP file in which each message
is a chunk with a checksum of its own, so whatever reads an unfinished file reads it too.
"""

from pathlib import Path

from mcap.records import Header

from rled_msgs_py.bags.mcap_chunks import chunk_record
from rled_msgs_py.bags.mcap_output import Output
from rled_msgs_py.bags.mcap_records import MAGIC, message_record, packed

SUFFIXES = (".journal", ".journal2")
"""Added to the name of the file that a journal belongs to, in turns: the next is whole before the last one goes."""


def journals_of(file: Path) -> list[Path]:
    """Paths of an .mcap file's journals, whether they are there or not."""
    return [file.with_name(file.name + suffix) for suffix in SUFFIXES]


class Journal:
    """The journal of a file that is being written.

    Args:
        file: the .mcap file.
        definitions: records of the message definitions and channels that the file has already.

    Attributes:
        count: messages that are safe here and in no chunk.

    Raises:
        OSError: (also from the methods) it cannot be written.
    """

    def __init__(self, file: Path, definitions: bytes) -> None:
        self._path, self._next = journals_of(file)
        self._definitions = definitions
        self._unfiled: dict[int, bytes] = {}
        self._output = self._begin(self._path)

    def define(self, definition: bytes) -> None:
        """Take the records of another message definition or channel."""
        self._definitions += definition
        self._output.write(chunk_record(definition, 0, 0, None))

    def add(self, channel: int, number: int, log_time: int, data: bytes) -> None:
        """Take a message; it is safe when this returns."""
        chunk = chunk_record(message_record(channel, number, log_time, log_time, data), log_time, log_time, None)
        self._output.write(chunk)
        self._unfiled[number] = chunk
        self.count += 1

    def file(self, number: int) -> None:
        """A message has found its place in the chunk in progress, or has none."""
        self._unfiled.pop(number, None)

    def renew(self) -> None:
        """Begin anew: the chunk is closed, so only what is not filed has to be kept here."""
        last, self._output, self._path, self._next = self._output, self._begin(self._next), self._next, self._path
        last.close()
        # renaming the one over the other instead would make the file system write them to the disk at once
        self._next.unlink()

    def close(self) -> None:
        """Close it as it is."""
        self._output.close()

    def remove(self) -> None:
        """Everything is in the file."""
        self._output.close()
        self._path.unlink()

    def _begin(self, path: Path) -> Output:
        self.count = len(self._unfiled)
        output = Output(path)
        output.write(MAGIC + packed(Header("ros2", "")) + chunk_record(self._definitions, 0, 0, None))
        output.write(b"".join(self._unfiled.values()))
        return output
