"""Reading a bag as records and as arrays."""

import logging
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np

from rled_msgs_py.bags.columns import payloads, read_record
from rled_msgs_py.bags.definitions import defines, definition
from rled_msgs_py.bags.error import BagError
from rled_msgs_py.bags.folder import open_files
from rled_msgs_py.bags.parts import DESCRIPTIONS, FilePart, divided, text_in
from rled_msgs_py.bags.storage import BagTopic, Messages, Storage
from rled_msgs_py.bags.stream import Message, stream
from rled_msgs_py.bags.tables import JointTable, PoseTable, joint_table, pose_table
from rled_msgs_py.errors import ContractError, command
from rled_msgs_py.records import Record, Text
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import STATE_TOPICS, StateRecord, Tick, TickAssembler
from rled_msgs_py.topics import CLOCK_TOPIC, DIAGNOSTICS, RECORDED, ROBOT_DESCRIPTION, TASK_DESCRIPTION, Topic

OUTSIDE = (DIAGNOSTICS.name, CLOCK_TOPIC.name)
"""Topics of the contract that lie in no namespace."""


class Bag:
    """A recorded bag: a rosbag2 folder or a bare file, in the storage MCAP or sqlite3.

    Topics are found below the namespace of ``task_description``, so a bag of a namespaced robot reads like any other.

    A recording during which the descriptions changed has several parts (``parts.py``), of which one is read.

    Args:
        path: where it lies.
        part: which part, counted from 1; by default the first, and what is passed over is said in the log.

    Attributes:
        path: where it lies.
        metadata: texts by name that were kept with it.
        counts: messages of each topic by name relative to the namespace, as in ``topics``; 0 for what is not there.
        parts: how many there are.
        note: what is passed over, in words; empty when nothing is.

    Raises:
        BagError: the bag is missing, empty, unfinished, damaged or foreign. Damage of a file that has no checksum of
            its own is found when the messages are read.
    """

    def __init__(self, path: Path, part: int | None = None) -> None:
        self.path, self.parts, self.note = Path(path), 1, ""
        self._files, self.metadata = open_files(self.path)
        self._namespace = self._find_namespace()
        self._foreign = self._find_foreign()
        self.counts = self._count()
        changed = [topic.name for topic in DESCRIPTIONS if self.counts[topic.name] > 1 and self._changes(topic)]
        if changed:
            self._choose(part or 1, " and ".join(changed))
        if part is None and self.note:
            logging.getLogger(__name__).warning(self.note)
        if not 1 <= (part or 1) <= self.parts:
            raise BagError(f"{self.path} has no part {part}", f"1 to {self.parts}")
        if not self.message_count:
            raise BagError(f"{self.path} holds no messages", "a recorded bag", "record it again")

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return self.counts.total()

    @property
    def namespace(self) -> str:
        """Namespace of the robot, between slashes."""
        return self._namespace

    @cached_property
    def task(self) -> TaskDescription:
        """The task that was recorded.

        Raises:
            BagError: there is no description, or it is not valid.
        """
        with self._located():
            return TaskDescription.from_json(self._latched(TASK_DESCRIPTION))

    @cached_property
    def robot_description(self) -> str:
        """The robot's URDF text.

        Raises:
            BagError: there is none.
        """
        return self._latched(ROBOT_DESCRIPTION)

    def records(self, topic: Topic) -> Iterator[Record]:
        """The records of a topic in log order.

        Raises:
            BagError: a message is damaged or not valid; names it.
        """
        for _, record in self._records([topic]):
            yield record

    def messages(self, *topics: Topic) -> Iterator[Message]:
        """Messages of some topics, by default of all, as they were received, in log order.

        Raises:
            BagError: the bag is damaged.
        """
        names = {self._absolute(topic) for topic in topics}
        return stream(self._files, lambda topic: not topics or (topic.name in names and topic not in self._foreign))

    def name_of(self, message: Message) -> str:
        """Name of a message's topic relative to the namespace, as in ``topics``."""
        return self._name(message.topic)

    def ticks(self) -> Iterator[Tick]:
        """The states of the simulation, each as one; a stamp at which a topic or a joint's position is missing is not.

        Raises:
            BagError: a message is damaged or not valid; names it.
        """
        assembler = TickAssembler(self.task.joint_names if self.counts[TASK_DESCRIPTION.name] else ())
        for topic, record in self._records(STATE_TOPICS):
            try:
                tick = assembler.add(topic.name, cast(StateRecord, record))
            except ContractError:  # a joint is not known
                continue
            if tick is not None:
                yield tick

    def joints(self, topic: Topic) -> JointTable:
        """All joint messages of a topic.

        Raises:
            BagError: a message is damaged or not valid; names it.
        """
        with self._located():
            return joint_table(topic, self._runs([topic]))

    def poses(self, topic: Topic) -> PoseTable:
        """All pose messages of a topic.

        Raises:
            BagError: a message is damaged, not valid, or in another frame than the first; names it.
        """
        with self._located():
            return pose_table(topic, self._runs([topic]))

    def _records(self, topics: Collection[Topic]) -> Iterator[tuple[Topic, Record]]:
        by_name = {self._absolute(topic): topic for topic in topics}
        found, times = list[tuple[Topic, int, bytes]](), list[int]()
        numbers: Counter[Topic] = Counter()
        for file, run in self._runs_of_files(topics):
            for channel, data in zip(run.channel.tolist(), payloads(run), strict=True):
                topic = by_name[file.topics[channel].name]
                found.append((topic, numbers[topic], data))
                numbers[topic] += 1
            times += run.log_time.tolist()
        with self._located():
            for place in np.argsort(np.array(times, np.int64), kind="stable").tolist():
                topic, number, data = found[place]
                yield topic, read_record(topic, number, data)

    def _runs(self, topics: Collection[Topic]) -> Iterator[Messages]:
        for _, run in self._runs_of_files(topics):
            yield run

    def _runs_of_files(self, topics: Collection[Topic]) -> Iterator[tuple[Storage, Messages]]:
        by_name = {self._absolute(topic): topic for topic in topics}
        for file in self._files:
            named = {channel: found for channel, found in file.topics.items() if found.name in by_name}
            channels = {channel: found for channel, found in named.items() if found not in self._foreign}
            for found in channels.values():
                self._require_type(found, by_name[found.name])
            for run in file.messages(channels):
                yield file, run

    def _count(self) -> Counter[str]:
        counts = Counter[str]()
        for file in self._files:
            for channel, topic in file.topics.items():
                counts[self._name(topic)] += file.counts.get(channel, 0)
        return counts

    def _changes(self, topic: Topic) -> bool:
        return len({tuple(text_in(data)) for run in self._runs([topic]) for data in payloads(run)}) > 1

    def _choose(self, number: int, changed: str) -> None:
        """Read one part from now on."""
        if not (parts := divided(self._files, self._name)):
            return
        self.parts, part = len(parts), parts[min(number, len(parts)) - 1]
        self._files = [FilePart(file, place, part, self._name) for place, file in enumerate(self._files)]
        self.counts = self._count()
        self.note = f"{self.path}: a message on {changed} that does not belong to the recording is passed over"
        if self.parts > 1:
            other = command("demos", "trim", self.path, "--part", str(1 + (number == 1)), "--output", "NEW")
            what = f"{self.path}: {changed} changes; this is part {number} of {self.parts}"
            self.note = f"{what}, another is made a bag with: {other}"

    def _latched(self, topic: Topic) -> str:
        for record in self.records(topic):
            return cast(Text, record).data
        accepted = "a recording that began with the simulation running"
        raise BagError(f"{self.path} holds no {topic.name}", accepted, "record it again with record_demos")

    def _find_namespace(self) -> str:
        topics = [topic for file in self._files for topic in file.topics.values()]
        names = {topic.name for topic in topics if topic.type == TASK_DESCRIPTION.type}
        found = sorted(name for name in names if name.endswith(f"/{TASK_DESCRIPTION.name}"))
        if len(found) > 1:
            raise BagError(f"{self.path} holds several robots: {', '.join(found)}", "one robot in a bag")
        return found[0].removesuffix(TASK_DESCRIPTION.name) if found else "/"

    def _absolute(self, topic: Topic) -> str:
        return topic.name if topic.name.startswith("/") else self._namespace + topic.name

    def _name(self, topic: BagTopic) -> str:
        """Relative name; of a channel of others that has the name of one of ours, with what it is."""
        name = topic.name if topic.name in OUTSIDE else topic.name.removeprefix(self._namespace)
        return f"{name} ({topic.type or topic.encoding})" if topic in self._foreign else name

    def _find_foreign(self) -> set[BagTopic]:
        """Channels of another type or encoding beside one of the same name that is ours: they are passed over."""
        wanted = {self._absolute(topic): ("cdr", topic.type) for topic in RECORDED}
        named = {topic for file in self._files for topic in file.topics.values() if topic.name in wanted}
        ours = {topic.name for topic in named if (topic.encoding, topic.type) == wanted[topic.name]}
        return {topic for topic in named if topic.name in ours and (topic.encoding, topic.type) != wanted[topic.name]}

    def _require_type(self, found: BagTopic, wanted: Topic) -> None:
        if found.encoding != "cdr" or found.type != wanted.type:
            what = f"{self.path} has {found.type} in the encoding '{found.encoding}' on {found.name}"
            raise BagError(what, f"{wanted.type} in the encoding 'cdr'")
        text, type_hash = definition(wanted.type)
        if found.definition_encoding == "ros2msg":
            same = found.definition == text or defines(found.definition, wanted.type)
        else:
            same = found.hash == type_hash
        if not same:
            raise BagError(f"{self.path} defines {found.type} otherwise", "the definition of ROS 2 Jazzy")

    @contextmanager
    def _located(self) -> Iterator[None]:
        try:
            yield
        except ContractError as error:
            raise BagError(f"{self.path}: {error.what}", error.accepted, error.remedy) from None
