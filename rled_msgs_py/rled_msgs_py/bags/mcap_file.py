"""A finished MCAP file as a storage of messages, checked against its checksums and counts."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from mmap import ACCESS_READ, mmap
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from rled_msgs_py.bags.error import BagError, Damage, ForeignBag, Oversized, remedy
from rled_msgs_py.bags.mcap_chunks import Chunk, require_measure, unpack
from rled_msgs_py.bags.mcap_records import HEAD, MAGIC, walk
from rled_msgs_py.bags.mcap_survey import Survey
from rled_msgs_py.bags.metadata import custom_of
from rled_msgs_py.bags.storage import BagTopic, Messages

RUN_BYTES = 4 << 20
"""Chunks are put together into runs of about this size, so that the array operations are worth their call."""

PAIR = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
MESSAGE = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)


def map_file(path: Path) -> mmap:
    """The bytes of an MCAP file.

    Raises:
        BagError: the file cannot be read, is empty or begins as something else.
    """
    try:
        if not path.is_file() and path.exists():  # a pipe would be waited for
            raise BagError(f"{path} is no regular file", "an .mcap file")
        with path.open("rb") as file:
            if not file.seek(0, 2):
                raise BagError(f"{path} is empty", "a recorded .mcap file", "record it again")
            data = mmap(file.fileno(), 0, access=ACCESS_READ)
    except OSError as error:
        raise BagError(f"{path} cannot be read: {error.strerror}", "an .mcap file") from None
    if data[: len(MAGIC)] != MAGIC:
        raise BagError(f"{path} is no MCAP file", "a rosbag2 recording in the storage 'mcap'")
    return data


@contextmanager
def located(path: Path) -> Iterator[None]:
    """Turn damage into an error that names the file."""
    try:
        yield
    except Oversized as damage:
        raise ForeignBag(f"{path} is refused: {damage}", "chunks as recorders write them") from None
    except Damage as damage:
        raise BagError(f"{path} is damaged: {damage}", "", remedy(path)) from None


class McapFile:
    """One finished .mcap file; a ``Storage``.

    Raises:
        BagError: the file is missing, foreign, unfinished or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._data = map_file(path)
        self._survey = Survey(self._data)
        if not self._survey.is_ended or self._data[self._survey.end :] != MAGIC:
            what = f"{path} is unfinished: it breaks off at byte {self._survey.end}"
            raise BagError(what, "a bag whose recorder ended in order", remedy(path))
        require_measure(self._survey.chunks, len(self._data), path)
        with located(path):
            self._check()
            definitions = self._survey.definitions
            self.counts: Mapping[int, int] = self._count()
            self.topics: Mapping[int, BagTopic] = {
                channel: _absolute(definitions.topic(channel)) for channel in {*definitions.channels, *self.counts}
            }
            self.custom: Mapping[str, str] = custom_of(self._survey.information[-1:])

    def messages(self, channels: Collection[int]) -> Iterator[Messages]:
        """Messages of some channels, in runs.

        Raises:
            BagError: a chunk is damaged, or fewer or more messages are found than the file lists.
        """
        wanted, found = set(channels), Counter[int]()
        with located(self.path):
            for run in self._runs(wanted):
                for channel, count in zip(*np.unique(run.channel, return_counts=True), strict=True):
                    found[channel] += count
                yield run
            for channel in wanted:
                if found[channel] != self.counts.get(channel, 0):
                    raise Damage(f"it holds {found[channel]} of {self.counts.get(channel, 0)} messages of a topic")

    def _check(self) -> None:
        if self._survey.damage:
            raise self._survey.damage[0]
        if self._survey.data_end is None:
            raise Damage("the end of its data is not marked")
        if not self._survey.has_right_data():
            raise Damage("its data fail their checksum")
        if not self._survey.has_right_summary():
            raise Damage("its summary fails its checksum")

    def _count(self) -> Mapping[int, int]:
        statistics, definitions = self._survey.statistics, self._survey.definitions
        if statistics is not None and len(definitions.channels) == statistics.channel_count:
            listed = statistics.channel_message_counts
            if sum(listed.values()) == statistics.message_count:  # the list may be left out
                return dict(listed)
        counts = Counter[int]()
        for chunk in self._survey.chunks:
            block = unpack(self._data, chunk)
            for opcode, start, stop in walk(block, 0, len(block)):
                definitions.take(opcode, block, start, stop)
                if opcode == Opcode.MESSAGE:
                    counts[int.from_bytes(block[start : start + 2], "little")] += 1
        return counts

    def _runs(self, wanted: set[int]) -> Iterator[Messages]:
        blocks, indexes, bases, base = list[bytes](), list[bytes](), list[tuple[int, int]](), 0
        for chunk in self._survey.chunks:
            if chunk.indexes and wanted.isdisjoint(chunk.indexes):
                continue
            block = unpack(self._data, chunk)
            index = self._index(chunk, block, wanted)
            if not index:
                continue
            blocks.append(block)
            indexes.append(index)
            bases.append((base, len(index) // PAIR.itemsize))
            base += len(block)
            if base > RUN_BYTES:
                yield _run(blocks, indexes, bases, wanted)
                blocks, indexes, bases, base = [], [], [], 0
        if blocks:
            yield _run(blocks, indexes, bases, wanted)

    def _index(self, chunk: Chunk, block: bytes, wanted: set[int]) -> bytes:
        """Pairs of log time and offset of the wanted messages in a block."""
        if chunk.indexes:
            spans = (chunk.indexes[channel] for channel in wanted if channel in chunk.indexes)
            index = b"".join(self._data[start:stop] for start, stop in spans)
            if len(index) % PAIR.itemsize:
                raise Damage(f"an index of the chunk at byte {chunk.start} breaks off")
            return index
        offsets, end = list[int](), 0
        for opcode, start, stop in walk(block, 0, len(block)):
            end = stop
            if opcode == Opcode.MESSAGE and int.from_bytes(block[start : start + 2], "little") in wanted:
                offsets.append(start - HEAD.size)
        if end != len(block):
            raise Damage(f"the records of the chunk at byte {chunk.start} do not fill it")
        pairs = np.zeros(len(offsets), PAIR)
        pairs["offset"] = offsets
        return pairs.tobytes()


def _absolute(topic: BagTopic) -> BagTopic:
    return topic._replace(name="/" + topic.name.lstrip("/"))


def _run(blocks: list[bytes], indexes: list[bytes], bases: list[tuple[int, int]], wanted: set[int]) -> Messages:
    data = b"".join(blocks)
    base, count = np.array(bases).T
    offsets = np.frombuffer(b"".join(indexes), PAIR)["offset"].astype(np.int64)
    at = np.sort(offsets + np.repeat(base, count))
    if len(at) and not 0 <= at[0] <= at[-1] <= len(data) - MESSAGE.itemsize:
        raise Damage("a message index points outside its chunk")
    heads = _heads(data, at)
    size = heads["length"].astype(np.int64) + HEAD.size - MESSAGE.itemsize
    start = at + MESSAGE.itemsize
    fits = (heads["opcode"] == Opcode.MESSAGE) & np.isin(heads["channel"], list(wanted)) & (size >= 0)
    if not fits.all() or (start + size > np.append(at[1:], len(data))).any():
        raise Damage("a message index points at something else")
    channel, log_time, publish_time = (heads[name].astype(np.int64) for name in ("channel", "log_time", "publish_time"))
    return Messages(data, channel, log_time, publish_time, start, size)


def _heads(data: bytes, at: NDArray[np.int64]) -> NDArray[np.void]:
    # a view of the buffer with a message head beginning at every byte
    views: NDArray[np.void] = np.ndarray(max(len(data) - MESSAGE.itemsize + 1, 0), MESSAGE, data, strides=(1,))
    return views[at]
