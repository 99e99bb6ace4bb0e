"""Recording: records of the contract into a rosbag2 folder."""

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType, TracebackType

from rled_msgs_py.bags.definitions import definition
from rled_msgs_py.bags.error import BagError, Unwritten, remedy
from rled_msgs_py.bags.holding import ORIGINAL, ROOM, replaced, taking_turns
from rled_msgs_py.bags.mcap_journal import SUFFIXES
from rled_msgs_py.bags.mcap_writer import McapWriter
from rled_msgs_py.bags.metadata import FILE_NAME, qos_profiles, write_metadata
from rled_msgs_py.bags.storage import BagTopic
from rled_msgs_py.messages import encode
from rled_msgs_py.records import Record
from rled_msgs_py.topics import Topic


def absolute(name: str) -> str:
    """Name of a topic of the contract in a bag, where every name is absolute."""
    return name if name.startswith("/") else f"/{name}"


def describe(topic: Topic) -> BagTopic:
    """A topic of the contract as a bag describes it."""
    text, type_hash = definition(topic.type)
    return BagTopic(absolute(topic.name), topic.type, "cdr", text, "ros2msg", type_hash, qos_profiles(topic.qos))


class BagWriter:
    """Writes a bag; a context manager, which completes the bag however its block ends.

    The folder is there from the start, so that a killed recording can be read (after ``repair``). ``metadata.yaml``
    comes last: a bag that has one is complete.

    Args:
        path: the bag's folder.
        metadata: texts by name, kept with the bag (``custom_data``).
        overwrite: take the place of a bag that is there already.

    Raises:
        BagError: the folder exists, or it cannot be written (from the methods too, naming what was kept).
    """

    def __init__(
        self, path: Path, *, metadata: Mapping[str, str] = MappingProxyType({}), overwrite: bool = False
    ) -> None:
        self.path = Path(path)
        self.counts: Counter[str] = Counter()
        self._channels: dict[Topic | BagTopic, int] = {}
        self._last_log_time = 0
        self._closed = False
        try:
            with taking_turns(self.path):
                _make_room(self.path, overwrite)
                self._file = McapWriter(self.path / f"{self.path.name}_0.mcap", metadata)
        except OSError as error:
            raise BagError(f"the folder {self.path} cannot be made: {error.strerror}") from None

    def write(self, topic: Topic, record: Record, log_time: int | None = None) -> None:
        """Write a record.

        Args:
            topic: topic of the contract.
            record: a record of the topic's kind.
            log_time: time of arrival (ns), by default the record's stamp.

        Raises:
            ContractError: the record is of another kind than the topic.
        """
        data = encode(topic, record)
        self.write_cdr(topic, data, getattr(record, "stamp", self._last_log_time) if log_time is None else log_time)

    def keep(self, topic: Topic, data: bytes, log_time: int) -> int:
        """Make a message safe that waits for its place among others: when this returns, no kill can lose it.

        Returns:
            Its number, under which ``write_cdr`` gives it its place.
        """
        return self._file.keep(self._channel(topic), max(log_time, 0), data)

    def forget(self, number: int) -> None:
        """A kept message has no place in the bag after all."""
        self._file.forget(number)

    def write_cdr(
        self, topic: Topic, data: bytes, log_time: int, publish_time: int | None = None, *, number: int | None = None
    ) -> None:
        """Write a message as it was received.

        Args:
            topic: topic of the contract.
            data: serialized message (CDR).
            log_time: time of arrival (ns). One before the last written becomes that, so that every reader keeps the
                order of writing, also when a simulation was restarted.
            publish_time: time of sending (ns), by default ``log_time``.
            number: what ``keep`` has returned, if the message was kept.
        """
        channel = self._channel(topic)
        self._last_log_time = max(log_time, self._last_log_time)
        sent = max(log_time if publish_time is None else publish_time, 0)
        self._file.add_message(channel, self._last_log_time, sent, data, number)
        self.counts[topic.name] += 1

    def copy(self, topic: BagTopic, data: bytes, log_time: int, publish_time: int) -> None:
        """Write a message of any topic as another bag describes it."""
        if topic not in self._channels:
            self._channels[topic] = self._file.add_topic(topic)
        self._last_log_time = max(log_time, self._last_log_time)
        self._file.add_message(self._channels[topic], self._last_log_time, max(publish_time, 0), data)
        self.counts[topic.name] += 1

    def flush(self) -> None:
        """Make what was written survive a kill. It closes a chunk: often done, the file grows and takes time."""
        self._file.flush()

    def close(self) -> None:
        """Complete the bag."""
        if self._closed or self._file.failed:
            return
        self._closed = True
        try:
            self._file.close()
            write_metadata(self.path, [self._file.summary()], self._file.custom)
        except OSError as error:
            what = f"writing {self.path / FILE_NAME} failed: {error.strerror}; kept: all messages"
            raise Unwritten(what, "", f"free space, then {remedy(self.path)}", error.strerror or "") from error
        finally:
            self._file.release()

    def remove(self) -> None:
        """Remove the bag, which is closed, unless another process has begun to write it.

        Raises:
            BagError: it cannot be removed.
        """
        try:
            with replaced(self.path):
                pass
        except OSError as error:
            raise BagError(f"{self.path} cannot be removed: {error.strerror}") from None

    def _channel(self, topic: Topic) -> int:
        if topic not in self._channels:
            self._channels[topic] = self._file.add_topic(describe(topic))
        return self._channels[topic]

    def __enter__(self) -> "BagWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _make_room(path: Path, overwrite: bool) -> None:
    """Make an empty folder.

    Raises:
        BagError: something is there that may not be removed, or another process writes it.
        OSError: it cannot be made.
    """
    with making_way(path, overwrite):
        path.mkdir()


@contextmanager
def making_way(path: Path, overwrite: bool) -> Iterator[None]:
    """A block in which a folder's name is free; what had it goes when the block ends without an error.

    Raises:
        BagError: something is there that may not be removed, or another process writes it.
        OSError: it cannot be moved.
    """
    if not path.exists():
        yield
        return
    require_replaceable(path, overwrite)
    with replaced(path):
        yield


def require_replaceable(path: Path, overwrite: bool) -> None:
    """See that a bag may take the place of what is there.

    Raises:
        BagError: it is a file or another folder, or a bag that may not be overwritten.
    """
    if not path.is_dir():
        raise BagError(f"{path} is a file", "the name of a folder that is not there yet")
    foreign = sorted(each.name for each in path.iterdir() if not _is_of_a_bag(each.name))
    if foreign:
        raise BagError(f"{path} exists and is no bag: it holds {foreign[0]}", "a folder that is not there yet")
    if not overwrite and any(path.iterdir()):
        raise BagError(
            f"{path} exists",
            "a folder that is not there yet",
            "choose another name, or --overwrite (overwrite:=true in a launch file)",
        )


def _is_of_a_bag(name: str) -> bool:
    begun = name.startswith(".") and (ROOM in name or name.startswith(f".{Path(FILE_NAME).stem}-"))
    return name == FILE_NAME or begun or Path(name).suffix in (".mcap", ORIGINAL, *SUFFIXES)
