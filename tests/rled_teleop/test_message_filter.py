"""Sizes are looked at before anything of a message is read or kept."""

import gc
import struct
import tracemalloc
from collections.abc import Callable
from math import nan

import pytest
from rled_msgs_py.errors import MAX_LENGTH, ContractError, RledError, Unreadable
from rled_msgs_py.messages import FROM, decode, encode
from rled_msgs_py.records import DeltaCommand, Text
from rled_msgs_py.topics import (
    EPISODE_EVENTS,
    JOINT_DELTA,
    JOINT_STATES,
    MARKERS,
    RECORDED,
    ROBOT_DESCRIPTION,
    TASK_DESCRIPTION,
)
from rled_teleop.recording.message_filter import MessageFilter
from rled_teleop.recording.recent import RecentMessages

HEAD, NEW = b"\0\1\0\0", b"next"
BY_NAME = {topic.name: topic for topic in (*RECORDED, MARKERS)}


def test_a_message_larger_than_its_topic_can_have_is_refused_unread() -> None:
    for topic in [each for each in BY_NAME.values() if each.name in FROM]:
        data = HEAD + bytes(topic.max_bytes)  # within its type it would be read: a stamp of 0, no names
        with pytest.raises(
            Unreadable, match=f"a message of {topic.max_bytes + 4} bytes; accepted: {topic.max_bytes} at most"
        ):
            decode(topic, data)


def test_a_large_description_is_read() -> None:
    for topic, size in [(ROBOT_DESCRIPTION, 4_000_000), (TASK_DESCRIPTION, 250_000)]:
        record = decode(topic, encode(topic, Text("x" * size)))
        assert isinstance(record, Text)
        assert len(record.data) == size


def test_a_robot_of_200_joints_is_read() -> None:
    names = tuple(f"a_humanoid/left_hand/finger_joint_number_{k}" for k in range(200))
    record = decode(JOINT_DELTA, encode(JOINT_DELTA, DeltaCommand(1, names, [0.0] * 200)))
    assert isinstance(record, DeltaCommand)
    assert record.names == names


def test_too_many_names_and_too_long_ones_are_refused() -> None:
    for names in [tuple(map(str, range(257))), ("a", "b" * 257)]:
        with pytest.raises(ContractError, match="256 at most"):
            DeltaCommand(1, names, [0.0] * len(names))


def growth(receive: Callable[[int], object]) -> int:
    """Bytes that are still held of what was received fifty times."""
    receive(0)
    tracemalloc.start()
    try:
        for number in range(1, 51):
            receive(number)
        gc.collect()
        return tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()


def joints(count: int, length: int) -> bytes:
    """A message of so many joints, whose names begin with ``NEW``."""
    names = [NEW + b"%06d" % k + b"n" * length + b"\0" for k in range(count)]
    parts = [HEAD, bytes(8), b"\1\0\0\0\0\0\0\0", len(names).to_bytes(4, "little")]
    for name in names:
        parts += [len(name).to_bytes(4, "little"), name, bytes(-len(name) % 4)]
    return b"".join(parts) + bytes(64)


def test_nothing_is_kept_of_names() -> None:
    for count, length in [(1, 2_900_000), (1, 60_000), (2500, 0), (256, 200), (200_000, 0)]:
        message = joints(count, length)

        def receive(number: int, message: bytes = message) -> None:
            with pytest.raises(ContractError) as error:
                decode(JOINT_DELTA, message.replace(NEW, b"%04d" % number))
            assert len(str(error.value)) < 3 * MAX_LENGTH

        assert growth(receive) < 2_000_000  # the newest lists of names are known: sixteen of 256 names at most


def test_an_error_quotes_no_more_than_a_person_reads() -> None:
    error = RledError("a" * 10**7, "b" * 10**7, "do this")
    assert len(str(error)) < 3000
    assert str(error).endswith("; do this")


def test_the_recorder_keeps_no_garbage_and_says_so_once() -> None:
    said: list[str] = []
    readable = MessageFilter(said.append)
    garbage = [
        b"",
        b"x",
        HEAD,
        bytes(1_000_000),
        HEAD + bytes(1_000_000),
        b"\xff" * 500,
        HEAD + bytes(8) + b"\xff" * 60,
    ]
    assert not any(readable.accepts(JOINT_STATES, each) for each in garbage * 100)
    assert not readable.accepts(MARKERS, bytes(5 << 20))
    assert readable.refused == {"joint_states": 700, "markers": 1}
    assert [each.split(":")[0] for each in said] == ["joint_states", "markers"]


def test_the_recorder_keeps_what_is_a_message_whatever_it_says() -> None:
    """A driver's NaN is what the robot sent."""
    said: list[str] = []
    data = encode(JOINT_DELTA, DeltaCommand(1, ("a",), [0.25])).replace(struct.pack("<d", 0.25), struct.pack("<d", nan))
    with pytest.raises(ContractError, match="delta holds nan"):
        decode(JOINT_DELTA, data)
    assert MessageFilter(said.append).accepts(JOINT_DELTA, data)
    assert said == []


def test_the_recorder_holds_one_description() -> None:
    recent = RecentMessages()
    for number in range(9):
        recent.add(ROBOT_DESCRIPTION, bytes([number]) * 1_000_000)
        recent.add(EPISODE_EVENTS, b"x")
    assert sum(len(each) for messages in recent._messages.values() for each in messages) == 1_000_001
