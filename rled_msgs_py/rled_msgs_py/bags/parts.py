"""A recording during which the descriptions changed, as parts of one robot and one task each.

A simulation that is started again with another option describes itself anew, and its stamps or counters begin anew.
What follows belongs to the new description, what was before to the old one. A description with which nothing begins
anew is a stray message and is passed over.
"""

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.bags.columns import payloads
from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.bags.stamps import fallen_back
from rled_msgs_py.bags.storage import BagTopic, Messages, Storage
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import decode
from rled_msgs_py.records import TaskStatus, Text
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import STATE_NAMES
from rled_msgs_py.topics import ROBOT_DESCRIPTION, TASK_DESCRIPTION, TASK_STATUS

NameOf = Callable[[BagTopic], str]
DESCRIPTIONS = (ROBOT_DESCRIPTION, TASK_DESCRIPTION)
EARLY, LATE = 400, 50
"""State messages after the first of a run among which a description is its own; before its last, the next run's, if it
comes no earlier."""
MAX_COUNT = 2**31
"""More episodes and steps than are counted."""
TOGETHER = 200
"""Messages within which the topics of a simulation that was started again begin anew."""


Key = tuple[int, int]
"""Number of a file and a channel in it."""


COUNTERS, WINDOW = "counters", 51


class Part(NamedTuple):
    """A stretch of a recording.

    Attributes:
        described: channels and numbers of the messages whose descriptions hold in it; they may come before it.
        first: of each channel, how many messages come before it.
        stop: of each channel, how many messages come before its end.
    """

    described: frozenset[tuple[Key, int]]
    first: Counter[Key]
    stop: Counter[Key]


class _Seen(NamedTuple):
    """What a recording holds: channels of all messages, texts of each description and states by their positions."""

    order: list[Key]
    texts: dict[str, list[tuple[int, str]]]
    states: list[int]
    starts: list[int]


class _Told(NamedTuple):
    """A description, and the position at which it came."""

    text: str
    position: int


class FilePart:
    """The messages of one part in one file; a ``Storage``.

    Args:
        file: the whole file.
        number: of the file.
        part: the part.
        name_of: name of a topic in the contract.
    """

    def __init__(self, file: Storage, number: int, part: Part, name_of: NameOf) -> None:
        self.topics, self.custom = file.topics, file.custom
        self._file, self._number, self._part = file, number, part
        names = {topic.name for topic in DESCRIPTIONS}
        self._describing = {channel for channel, topic in file.topics.items() if name_of(topic) in names}
        self.counts = Counter[int]()
        for channel in file.topics:
            key = number, channel
            described = sum(channel_of == key for channel_of, _ in part.described)
            self.counts[channel] = described if channel in self._describing else part.stop[key] - part.first[key]

    def messages(self, channels: Collection[int]) -> Iterator[Messages]:
        """Messages of some channels, in runs.

        Raises:
            BagError: the file is damaged there.
        """
        passed = Counter[int]()
        for run in self._file.messages(channels):
            stays = np.zeros(len(run.channel), dtype=bool)
            for channel in channels:
                places = np.flatnonzero(run.channel == channel)
                stays[places] = self._stays(channel, passed[channel] + np.arange(len(places)))
                passed[channel] += len(places)
            yield run.chosen(stays)

    def _stays(self, channel: int, numbers: NDArray[np.intp]) -> NDArray[np.bool_]:
        key = self._number, channel
        if channel in self._describing:
            return np.isin(numbers, [number for channel_of, number in self._part.described if channel_of == key])
        stays: NDArray[np.bool_] = (numbers >= self._part.first[key]) & (numbers < self._part.stop[key])
        return stays


def divided(files: Sequence[Storage], name_of: NameOf) -> list[Part]:
    """The parts of a recording; none where there is no valid description of a task.

    Args:
        files: its files.
        name_of: name of a topic in the contract.
    """
    seen = _look(files, name_of)
    tasks = _in_force(seen, TASK_DESCRIPTION.name, [()] * len(seen.starts))
    if not tasks[0].text:
        return []
    joints = [TaskDescription.from_json(each.text).joint_names for each in tasks]
    robots = _in_force(seen, ROBOT_DESCRIPTION.name, joints)
    bounds, found = list[int](), list[tuple[_Told, _Told]]()
    for start, task, robot in zip(seen.starts, tasks, robots, strict=True):
        if not found or (found[-1][0].text, found[-1][1].text) != (task.text, robot.text):
            bounds.append(start)
            found.append((task, robot))
    counts = [Counter(seen.order[:bound]) for bound in [*bounds, len(seen.order)]]
    described = [frozenset(_number(seen.order, each.position) for each in pair if each.text) for pair in found]
    return [Part(each, counts[place], counts[place + 1]) for place, each in enumerate(described)]


def _number(order: list[Key], position: int) -> tuple[Key, int]:
    """Channel of a message, and its number among those of it."""
    return order[position], order[:position].count(order[position])


def _look(files: Sequence[Storage], name_of: NameOf) -> _Seen:
    texts: dict[str, list[tuple[int, str]]] = {topic.name: [] for topic in DESCRIPTIONS}
    stamps: dict[str, list[tuple[int, int]]] = {name: [] for name in STATE_NAMES}
    order, states, counters, tick = list[Key](), list[int](), list[tuple[int, int]](), (-1, -1)
    for key, topic, data in _all(files):
        name, position = name_of(topic), len(order)
        order.append(key)
        if name in texts:
            texts[name] += [(position, text) for text in text_in(data)]
        elif name in stamps:
            states.append(position)
            stamps[name].append((position, stamp_of(topic.type, data) or 0))
            tick = tick if stamps[name][-1][1] == tick[1] else stamps[name][-1]
        if name == TASK_STATUS.name:  # its counters begin anew with the tick that it is part of
            counters.append((tick[0], _counter(data, counters[-1][1] if counters else 0)))
    falls = {fall for name, found in stamps.items() for fall in _falls(name, found)} | set(_resets(counters))
    return _Seen(order, texts, states, _starts(sorted(falls), {name for name, found in stamps.items() if found}))


def _falls(name: str, found: list[tuple[int, int]]) -> Iterator[tuple[int, str]]:
    places = np.flatnonzero(fallen_back(np.array([value for _, value in found], np.int64)))
    return ((found[place][0], name) for place in places.tolist())


def _resets(counters: list[tuple[int, int]]) -> Iterator[tuple[int, str]]:
    """Where counters begin anew: they fall below most of those before, not only below a stray message's."""
    values = np.array([value for _, value in counters], np.int64)
    for place in np.flatnonzero(fallen_back(values)).tolist():
        if values[place] < np.median(values[max(place - WINDOW, 0) : place]):
            yield counters[place][0], COUNTERS


def _all(files: Sequence[Storage]) -> Iterator[tuple[Key, BagTopic, bytes]]:
    for number, file in enumerate(files):
        for run in file.messages(file.topics):
            for channel, data in zip(run.channel.tolist(), payloads(run), strict=True):
                yield (number, channel), file.topics[channel], data


def text_in(data: bytes) -> list[str]:
    """The text of a serialized description; none where it cannot be read."""
    try:
        return [cast(Text, decode(TASK_DESCRIPTION, data)).data]
    except ContractError:
        return []


def _counter(data: bytes, before: int) -> int:
    """Episode and step as one number that grows."""
    try:
        status = cast(TaskStatus, decode(TASK_STATUS, data))
    except ContractError:
        return before
    return min(status.episode, MAX_COUNT) * MAX_COUNT + min(status.step, MAX_COUNT)


def _starts(falls: list[tuple[int, str]], recorded: set[str]) -> list[int]:
    """Positions at which the simulation begins anew; the first run begins at 0.

    All its topics begin anew there, one after the other, or its counters: a topic that falls back alone has a second
    publisher.
    """
    clusters = list[tuple[int, set[str]]]()
    for position, name in falls:
        if not clusters or name in clusters[-1][1] or position - clusters[-1][0] > TOGETHER:
            clusters.append((position, set()))
        clusters[-1][1].add(name)
    return [0, *(position for position, names in clusters if names >= recorded or COUNTERS in names)]


def _in_force(seen: _Seen, name: str, joints: list[tuple[str, ...]]) -> list[_Told]:
    """The description of each run, that of the run before where it has none of its own."""
    own: list[_Told | None] = [None] * len(seen.starts)
    for position, text in seen.texts[name]:
        run = bisect_right(seen.starts, position) - 1
        ends = seen.starts[run], position, [*seen.starts, len(seen.order)][run + 1]
        first, here, stop = (bisect_left(seen.states, each) for each in ends)
        is_own = here - first <= EARLY or stop - here > LATE  # each simulation describes itself, if late
        if is_own and own[run] is None and _fits(name, text, joints[run]):
            own[run] = _Told(text, position)
        elif stop - here <= LATE and run + 1 < len(own) and _fits(name, text, joints[run + 1]):
            own[run + 1] = _Told(text, position)
    fitting = (_Told(text, position) for position, text in seen.texts[name] if _fits(name, text, joints[0]))
    before, found = next(fitting, _Told("", 0)), list[_Told]()
    for each in own:
        before = each or before
        found.append(before)
    return found


def _fits(name: str, text: str, joints: tuple[str, ...]) -> bool:
    if name == ROBOT_DESCRIPTION.name:
        return bool(text) and (not joints or "<joint" not in text or all(joint in text for joint in joints))
    try:
        TaskDescription.from_json(text)
    except ContractError:
        return False
    return True
