"""Completing a bag whose recorder was killed, or saving what is whole of a damaged one."""

import fcntl
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from mmap import mmap
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode

from rled_msgs_py.bags.error import BagError, Damage
from rled_msgs_py.bags.folder import mcap_files, open_files
from rled_msgs_py.bags.mcap_chunks import unpack
from rled_msgs_py.bags.mcap_file import McapFile, map_file
from rled_msgs_py.bags.mcap_journal import journals_of
from rled_msgs_py.bags.mcap_records import MESSAGE_HEAD, Definitions, walk
from rled_msgs_py.bags.mcap_survey import Survey
from rled_msgs_py.bags.mcap_writer import McapWriter
from rled_msgs_py.bags.metadata import NO_TIME, FileSummary, custom_of, write_metadata
from rled_msgs_py.bags.storage import BagTopic, Storage

ROOM = ".repair"
"""Folder beside a file, in which its successor is written."""


class Repaired(NamedTuple):
    """What a repair did.

    Attributes:
        messages: messages that the bag holds now.
        lost: what was left out, each part in words; empty when the bag was complete.
    """

    messages: int
    lost: list[str]


class _Message(NamedTuple):
    number: int
    topic: BagTopic
    log_time: int
    publish_time: int
    data: bytes


def repair(path: Path) -> Repaired:
    """Make a bag complete: rewrite each unfinished or damaged file from what is whole in it and its journal.

    A file is replaced at once, when its successor is whole on the disk, so an interrupted repair loses nothing. A bag
    that is complete already is left as it is.

    Args:
        path: a bag's folder, or a bare .mcap file.

    Raises:
        BagError: no bag, a recorder is still writing it, nothing in it can be saved, or it cannot be written.
    """
    path = Path(path)
    files = mcap_files(path) if path.is_dir() else [path]
    if not files or not path.exists():
        raise BagError(f"{path} holds no .mcap file", "a bag's folder or an .mcap file", "is the path right?")
    for file in files:
        _require_idle(file)
    if (messages := _messages_if_complete(path)) is not None:
        return Repaired(messages, [])
    lost = list[str]()
    summaries = [_repair_file(file, lost) for file in files]
    if path.is_dir():
        _write_metadata(path, summaries, McapFile(files[-1]).custom)
    return Repaired(sum(sum(summary.counts.values()) for summary in summaries), lost)


def _require_idle(file: Path) -> None:
    try:
        with file.open("rb") as opened, suppress(OSError):  # a file system without locks
            if _is_locked(opened.fileno()):
                raise BagError(f"{file} is being recorded", "a bag that nobody writes", "end the recorder first")
    except OSError as error:
        raise BagError(f"{file} cannot be read: {error.strerror}") from None


def _is_locked(file: int) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def _messages_if_complete(path: Path) -> int | None:
    try:
        files, _ = open_files(path)
        return sum(sum(_summary(path, file).counts.values()) for file in files)
    except BagError:
        return None


def _summary(path: Path, file: Storage) -> FileSummary:
    """What a complete file holds; reads all of it.

    Raises:
        BagError: it is damaged.
    """
    first, last, counts = NO_TIME, 0, Counter[BagTopic]()
    for run in file.messages(file.topics):
        first, last = min(first, *run.log_time.tolist()), max(last, *run.log_time.tolist())
    for channel, topic in file.topics.items():
        counts[topic] += file.counts.get(channel, 0)
    return FileSummary(path.name, first, last, counts)


def _repair_file(file: Path, lost: list[str]) -> FileSummary:
    try:
        summary = _summary(file, McapFile(file))
    except BagError:
        summary = _rewrite(file, lost)
    with suppress(OSError):  # the file is complete, what is left beside it does no harm
        for journal in journals_of(file):
            journal.unlink(missing_ok=True)
    return summary


def _rewrite(file: Path, lost: list[str]) -> FileSummary:
    room = file.parent / ROOM
    try:
        shutil.rmtree(room, ignore_errors=True)
        room.mkdir()
        summary = _save(file, room / file.name, lost)
        if not summary.counts:
            raise BagError(f"nothing in {file} can be saved", "a file with one whole chunk of messages")
        (room / file.name).replace(file)
    except OSError as error:
        raise BagError(f"{file} cannot be repaired: {error.strerror}; it is as it was") from None
    finally:
        shutil.rmtree(room, ignore_errors=True)
    return summary


def _save(file: Path, successor: Path, lost: list[str]) -> FileSummary:
    data = map_file(file)
    survey = _survey(data, lost)
    journal = _journaled(file, lost)
    writer = McapWriter(successor, _custom(survey, lost))
    channels = dict[BagTopic, int]()

    def write(message: _Message) -> None:
        if message.topic not in channels:
            channels[message.topic] = writer.add_topic(message.topic)
        writer.add_message(channels[message.topic], message.log_time, message.publish_time, message.data)

    for message in _whole_messages(survey, data, lost):
        write(message)
        twin = journal.get(message.number)
        if twin and (twin.topic, twin.data) == (message.topic, message.data):
            del journal[message.number]
    so_far = writer.summary()
    for message in _in_order(journal.values(), so_far.last):
        write(message)
    writer.close()
    if survey.statistics is not None and survey.has_right_summary():
        missing = survey.statistics.message_count - sum(so_far.counts.values())
        lost += [f"{missing} messages of those that were counted"] if missing else []
    return writer.summary()


def _survey(data: mmap, lost: list[str]) -> Survey:
    survey = Survey(data)
    lost += map(str, survey.damage)
    if not survey.is_ended and survey.end < len(data):
        lost.append(f"the last {len(data) - survey.end} bytes, in which a record breaks off")
    return survey


def _journaled(file: Path, lost: list[str]) -> dict[int, _Message]:
    """What the recorder of a file has kept beside it, by number, in the order of reception."""
    found = dict[int, _Message]()
    for journal in filter(Path.exists, journals_of(file)):
        try:
            data = map_file(journal)
        except BagError as error:
            lost.append(error.what)
        else:
            found |= {each.number: each for each in _whole_messages(_survey(data, lost), data, lost)}
    return dict(sorted(found.items()))


def _in_order(received: Iterable[_Message], last: int) -> Iterator[_Message]:
    """Messages by log time, but those after a restart of the simulation after those before it.

    What was received before any stamp was known goes with the first stamp.

    Args:
        received: in the order of reception.
        last: log time before which none may lie (ns).
    """
    runs, newest = [list[_Message]()], dict[BagTopic, int]()
    for message in received:
        if message.log_time < newest.get(message.topic, 0):
            runs.append([])
            newest.clear()
        newest[message.topic] = message.log_time
        runs[-1].append(message)
    last = max(last, min((each.log_time for each in runs[0] if each.log_time), default=0))
    for run in runs:
        for message in sorted(run, key=attrgetter("log_time")):
            last = max(last, message.log_time)
            yield message._replace(log_time=last)


def _custom(survey: Survey, lost: list[str]) -> dict[str, str]:
    try:
        return custom_of(survey.information)
    except Damage as damage:
        lost.append(str(damage))
        return {}


def _whole_messages(survey: Survey, data: mmap, lost: list[str]) -> Iterator[_Message]:
    # definitions in a chunk are under its checksum, those of a summary are only as good as its own
    definitions = survey.definitions if survey.has_right_summary() else Definitions()
    for chunk in survey.chunks:
        try:
            block = unpack(data, chunk)
            for opcode, start, stop in walk(block, 0, len(block)):
                definitions.take(opcode, block, start, stop)
                if opcode == Opcode.MESSAGE and stop - start >= MESSAGE_HEAD.size:
                    channel, number, log_time, publish_time = MESSAGE_HEAD.unpack_from(block, start)
                    content = block[start + MESSAGE_HEAD.size : stop]
                    yield _Message(number, definitions.topic(channel), log_time, publish_time, content)
        except Damage as damage:
            lost.append(str(damage))


def _write_metadata(folder: Path, summaries: Sequence[FileSummary], custom: Mapping[str, str]) -> None:
    try:
        write_metadata(folder, summaries, custom)
    except OSError as error:
        raise BagError(f"the metadata of {folder} cannot be written: {error.strerror}") from None
