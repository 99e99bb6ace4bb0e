"""The chunk in progress of an MCAP file that is being written."""

from struct import pack

import zstandard
from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from rled_msgs_py.bags.mcap_chunks import ZSTD, ZSTD_OVERHEAD, chunk_record
from rled_msgs_py.bags.mcap_records import HEAD, message_record, packed
from rled_msgs_py.bags.metadata import NO_TIME


class ChunkBuilder:
    """Gathers records, until ``close`` makes a chunk of them."""

    def __init__(self) -> None:
        self._records = bytearray()
        self._indexes: dict[int, list[int]] = {}
        self._first, self._last = NO_TIME, 0
        self._packer = zstandard.ZstdCompressor()

    @property
    def size(self) -> int:
        """Bytes gathered."""
        return len(self._records)

    @property
    def has_messages(self) -> bool:
        """Whether there is something to close; definitions alone wait for the first message."""
        return bool(self._indexes)

    def define(self, definition: bytes) -> None:
        """Take the record of a message definition or a channel."""
        self._records += definition

    def add(self, channel: int, number: int, log_time: int, publish_time: int, data: bytes) -> None:
        """Take a message."""
        self._indexes.setdefault(channel, []).extend((log_time, len(self._records)))
        self._records += message_record(channel, number, log_time, publish_time, data)
        self._first, self._last = min(self._first, log_time), max(self._last, log_time)

    def close(self, start: int) -> tuple[bytes, bytes]:
        """End the chunk and begin another.

        Args:
            start: where it will lie in the file.

        Returns:
            The chunk with the indexes of its messages, and the record that tells the summary about both.
        """
        chunk = chunk_record(self._records, self._first, self._last, self._packer)
        parts, offsets, end = [chunk], dict[int, int](), start + len(chunk)
        for channel, pairs in self._indexes.items():
            offsets[channel] = end
            parts.append(_message_index(channel, pairs))
            end += len(parts[-1])
        summary = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=start,
            compression=ZSTD,
            compressed_size=len(chunk) - ZSTD_OVERHEAD,
            message_end_time=self._last,
            message_index_length=end - start - len(chunk),
            message_index_offsets=offsets,
            message_start_time=self._first,
            uncompressed_size=len(self._records),
        )
        self._records.clear()
        self._indexes.clear()
        self._first, self._last = NO_TIME, 0
        return b"".join(parts), packed(summary)


def _message_index(channel: int, pairs: list[int]) -> bytes:
    content = pack(f"<HI{len(pairs)}Q", channel, 8 * len(pairs), *pairs)
    return HEAD.pack(Opcode.MESSAGE_INDEX, len(content)) + content
