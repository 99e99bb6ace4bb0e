"""Completing a bag whose recorder was killed, or saving what is whole of a damaged one.

A file is replaced when its successor is whole on the disk and proven to hold what can be read of it, or more. Where
something could not be saved the file stays beside its successor, under a name that says so.
"""

import os
import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from itertools import count
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

from mcap.opcode import Opcode

from rled_msgs_py.bags.error import BagError, Damage, ForeignBag, Unwritten
from rled_msgs_py.bags.folder import mcap_files, open_files
from rled_msgs_py.bags.holding import ORIGINAL, hold, remove_temporary_folders, temporary_folder
from rled_msgs_py.bags.mcap_chunks import require_measure
from rled_msgs_py.bags.mcap_file import McapFile, located, map_file
from rled_msgs_py.bags.mcap_journal import journals_of
from rled_msgs_py.bags.mcap_survey import Survey
from rled_msgs_py.bags.mcap_writer import McapWriter
from rled_msgs_py.bags.metadata import (
    FILE_NAME,
    NO_TIME,
    Contents,
    FileSummary,
    custom_of,
    read_metadata,
    write_metadata,
)
from rled_msgs_py.bags.proof import require_all
from rled_msgs_py.bags.rescue import Rescued, in_order, journaled, rescued, summary_of, torn
from rled_msgs_py.bags.storage import BagTopic, Storage

CRC_BYTES = 4


class NothingWhole(BagError):
    """A file of which nothing can be saved."""


class Repaired(NamedTuple):
    """What a repair did.

    Attributes:
        messages: messages that the bag holds now.
        lost: what was left out, each part in words; empty when the bag was complete.
        kept: files as they were, where something of them was left out.
    """

    messages: int
    lost: list[str]
    kept: list[Path]

    def lines(self, path: Path) -> list[str]:
        """What a person is told of it."""
        lost = [f"lost: {part}" for part in self.lost]
        kept = [f"kept as it was: {file}" for file in self.kept]
        return [*lost, *kept, f"{path} is complete and holds {self.messages} messages"]


def repair(path: Path) -> Repaired:
    """Make a bag complete: rewrite each unfinished or damaged file from what is whole in it and its journal.

    An interrupted repair loses nothing. A bag that is complete already is left as it is.

    Args:
        path: a bag's folder, or a bare .mcap file.

    Raises:
        BagError: no bag, another process is writing it, nothing in it can be saved, or it cannot be written. What was
            not saved is as it was then.
    """
    path = Path(path)
    metadata = _metadata_of(path)
    files = _files_of(path, metadata)
    with ExitStack() as held:
        for file in files:
            held.enter_context(hold(file))
        if (messages := _messages_if_complete(path)) is not None:
            return Repaired(messages, [], [])
        lost, kept = list[str](), list[Path]()
        summaries = _repair_files(files, lost, kept)
        if path.is_dir():
            _write_metadata(path, metadata, summaries, kept)
    return Repaired(sum(sum(summary.counts.values()) for summary in summaries), lost, kept)


def _metadata_of(path: Path) -> Contents | None:
    """What ``metadata.yaml`` says, None where there is none that can be read.

    Raises:
        ForeignBag: the bag is of a kind that is not read.
    """
    try:
        return read_metadata(path) if path.is_dir() else None
    except ForeignBag:
        raise
    except BagError:
        return None


def _files_of(path: Path, metadata: Contents | None) -> list[Path]:
    """The files of a bag in order: those that its metadata list if they are there, or else all.

    Raises:
        BagError: there are none.
    """
    files = mcap_files(path) if path.is_dir() else [path]
    if not files or not path.exists():
        raise BagError(f"{path} holds no .mcap file", "a bag's folder or an .mcap file", "is the path right?")
    listed = [path / name for name in metadata.files] if metadata else []
    return listed if listed and set(listed) <= set(files) else files


def _messages_if_complete(path: Path) -> int | None:
    try:
        files, _ = open_files(path)
        return sum(sum(_summary(path, file).counts.values()) for file in files)
    except ForeignBag:
        raise
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


def _repair_files(files: Sequence[Path], lost: list[str], kept: list[Path]) -> list[FileSummary]:
    """Repair one file after the other; one of which nothing can be saved stays as it is, unless there is no other.

    Raises:
        BagError: nothing can be saved, or a file cannot be written.
    """
    summaries, hopeless = list[FileSummary](), list[NothingWhole]()
    for file in files:
        try:
            summaries.append(_repair_file(file, lost, kept))
        except NothingWhole as error:
            hopeless.append(error)
    if hopeless and not any(sum(summary.counts.values()) for summary in summaries):
        raise hopeless[0]
    lost += [error.what for error in hopeless]
    return summaries


def _repair_file(file: Path, lost: list[str], kept: list[Path]) -> FileSummary:
    losses = list[str]()
    try:
        summary = _summary(file, McapFile(file))
    except ForeignBag:
        raise
    except BagError:
        summary = _rewrite(file, losses, kept)
    lost += losses
    with suppress(OSError):  # the file is complete, what is left beside it does no harm
        for journal in filter(Path.exists, journals_of(file)):
            if losses:
                kept.append(_keep(journal))
            journal.unlink()
    return summary


def _rewrite(file: Path, lost: list[str], kept: list[Path]) -> FileSummary:
    """Put in the place of a file what is whole of it.

    Raises:
        BagError: it cannot be done, and the file is as it was.
    """
    remove_temporary_folders(file)
    try:
        with temporary_folder(file) as room, located(file):
            summary = _save(file, room / file.name, lost)
            if not summary.counts:
                raise NothingWhole(f"nothing in {file} can be saved", "a file with one whole chunk of messages")
            require_all(file, room / file.name)
            kept += [_keep(file)] if lost else []
            (room / file.name).replace(file)
    except (OSError, Unwritten) as error:
        reason = error.reason if isinstance(error, Unwritten) else error.strerror
        raise BagError(f"{file} cannot be repaired: {reason}; it is as it was") from None
    return summary


def _keep(file: Path) -> Path:
    """Give a file a second name, by which it stays when another takes its place.

    Raises:
        OSError: there is no room for it.
    """
    for number in count(1):
        name = file.with_name(f"{file.name}.{number}{ORIGINAL}" if number > 1 else file.name + ORIGINAL)
        if not name.exists():
            try:
                os.link(file, name)
            except FileExistsError:
                continue
            except OSError:  # a file system without a second name for a file
                shutil.copy2(file, name)
            return name
    raise AssertionError


def _save(file: Path, successor: Path, lost: list[str]) -> FileSummary:
    data = map_file(file)
    survey = Survey(data)
    require_measure(survey.chunks, len(data), file)
    lost += [*map(str, survey.damage), *torn(data)]
    writer = McapWriter(successor, _custom(survey, lost), survey.profile)
    channels, journal = dict[BagTopic, int](), journaled(file, lost)

    def write(message: Rescued) -> None:
        if message.topic not in channels:
            channels[message.topic] = writer.add_topic(message.topic)
        times = message.log_time, message.publish_time
        writer.add_message(channels[message.topic], *times, message.data, message.number)

    for opcode, start, stop in survey.others:
        _copy_other(writer, opcode, data[start:stop], lost)
    for message in rescued(data, lost):
        write(message)
        twin = journal.get(message.number)
        if twin and (twin.topic, twin.data) == (message.topic, message.data):
            del journal[message.number]
    so_far = writer.summary()
    for message in in_order(journal.values(), so_far.last):
        write(message)
    writer.close()
    writer.release()
    if (counted := summary_of(data).statistics) is not None:
        missing = counted.message_count - sum(so_far.counts.values())
        lost += [f"{missing} messages of those that were counted"] if missing > 0 else []
    return writer.summary()


def _copy_other(writer: McapWriter, opcode: int, content: bytes, lost: list[str]) -> None:
    try:
        if opcode == Opcode.ATTACHMENT:
            crc = int.from_bytes(content[-CRC_BYTES:], "little")
            if crc and crc32(content[:-CRC_BYTES]) != crc:
                raise Damage("an attachment fails its checksum")
        writer.add_record(opcode, content)
    except Damage as damage:
        lost.append(str(damage))


def _custom(survey: Survey, lost: list[str]) -> dict[str, str]:
    try:
        return custom_of(survey.information)
    except Damage as damage:
        lost.append(str(damage))
        return {}


def _write_metadata(folder: Path, known: Contents | None, summaries: Sequence[FileSummary], kept: list[Path]) -> None:
    custom = dict(McapFile(folder / summaries[-1].name).custom) or (known.custom if known else {})
    try:
        if known is None and (folder / FILE_NAME).exists():
            kept.append(_keep(folder / FILE_NAME))
        write_metadata(folder, summaries, custom)
    except OSError as error:
        raise BagError(f"the metadata of {folder} cannot be written: {error.strerror}") from None
