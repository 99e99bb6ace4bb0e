"""Messages of a recording: where it begins, and in what order they are written."""

import struct
import time
from itertools import permutations

import pytest
from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import DIAGNOSTICS, EE_POSE, JOINT_DELTA, JOINT_STATES, MARKERS, ROBOT_DESCRIPTION, Topic
from rled_teleop.recording import start_synchronisation
from rled_teleop.recording.reorder_buffer import ReorderBuffer
from rled_teleop.recording.start_synchronisation import EarlyMessage, StartSynchronisation

RANKS = {ROBOT_DESCRIPTION: 0, JOINT_STATES: 1, EE_POSE: 2, JOINT_DELTA: 3}


def message(stamp: int, payload: bytes = b"payload.") -> bytes:
    return b"\x00\x01\x00\x00" + struct.pack("<iI", *divmod(stamp, 10**9)) + payload


def order_of(messages: list[tuple[Topic, bytes]]) -> list[tuple[int, str]]:
    buffer = ReorderBuffer()
    for number, (topic, data) in enumerate(messages):
        buffer.add(topic, RANKS[topic], data, number)
    return [(each.stamp, each.topic.name) for each in buffer.rest()]


def test_the_stamp_of_a_little_and_a_big_endian_message_is_read() -> None:
    assert stamp_of(JOINT_STATES.type, message(3_000_000_020)) == 3_000_000_020
    assert stamp_of(JOINT_STATES.type, b"\x00\x00\x00\x00" + struct.pack(">iI", 3, 20)) == 3_000_000_020


def test_a_text_a_marker_array_and_a_stump_have_no_stamp() -> None:
    assert stamp_of(ROBOT_DESCRIPTION.type, message(5)) is None
    assert stamp_of(MARKERS.type, message(5)) is None
    assert stamp_of(JOINT_STATES.type, b"\x00\x01\x00\x00\x00") is None


def test_any_delivery_of_two_ticks_gives_one_order() -> None:
    delivered = [(topic, message(stamp)) for stamp in (0, 20) for topic in (JOINT_STATES, EE_POSE, JOINT_DELTA)]
    expected = [(stamp, name) for stamp in (0, 20) for name in ("joint_states", "ee_pose", "joint_delta")]
    assert all(order_of(list(each)) == expected for each in permutations(delivered))


def test_a_text_is_filed_under_the_first_stamp() -> None:
    assert order_of([(ROBOT_DESCRIPTION, b"text"), (JOINT_STATES, message(40))]) == [
        (40, "robot_description"),
        (40, "joint_states"),
    ]


def test_a_text_without_any_stamp_is_filed_under_zero() -> None:
    assert order_of([(ROBOT_DESCRIPTION, b"text")]) == [(0, "robot_description")]


def test_messages_of_one_topic_and_stamp_keep_their_order() -> None:
    buffer = ReorderBuffer()
    for number in range(5):
        buffer.add(JOINT_STATES, 1, message(20, bytes([number])), number)
    assert [each.data[-1] for each in buffer.rest()] == [0, 1, 2, 3, 4]


def test_the_time_of_the_day_on_diagnostics_is_no_stamp() -> None:
    buffer = ReorderBuffer()
    buffer.add(JOINT_STATES, 1, message(20), 0)
    buffer.add(DIAGNOSTICS, 0, message(1_700_000_000 * 10**9), 1)
    buffer.add(JOINT_STATES, 1, message(40), 2)
    assert [each.stamp for each in buffer.rest()] == [20, 20, 40]


def test_texts_keep_their_order_when_a_late_message_comes_between() -> None:
    buffer = ReorderBuffer()
    for number, (topic, data) in enumerate(
        [
            (JOINT_STATES, message(40)),
            (ROBOT_DESCRIPTION, b"first"),
            (JOINT_DELTA, message(20)),
            (ROBOT_DESCRIPTION, b"second"),
        ]
    ):
        buffer.add(topic, RANKS[topic], data, number)
    assert [each.data for each in buffer.rest() if each.topic is ROBOT_DESCRIPTION] == [b"first", b"second"]


def test_a_message_waits_for_two_calls_at_most() -> None:
    buffer = ReorderBuffer()
    buffer.add(JOINT_STATES, 1, message(20), 0)
    assert buffer.due() == []
    buffer.add(JOINT_STATES, 1, message(40), 1)
    assert [each.stamp for each in buffer.due()] == [20]
    assert [each.stamp for each in buffer.due()] == [40]
    assert buffer.due() == []


def test_a_stamp_before_the_newest_is_not_held_back() -> None:
    buffer = ReorderBuffer()
    buffer.add(JOINT_STATES, 1, message(1000), 0)
    buffer.due()
    buffer.add(JOINT_STATES, 1, message(20), 1)
    assert [each.stamp for each in buffer.due()] == [20, 1000]


def test_a_recording_begins_with_the_first_tick_that_all_topics_have() -> None:
    early = StartSynchronisation()
    received = [(topic, k) for since, topic in enumerate(STATE_TOPICS) for k in range(since, 6)]
    for topic, k in received:
        assert not early.is_ready() or topic is STATE_TOPICS[-1]
        early.add(EarlyMessage(topic, 0, k, b""))
    assert early.is_ready()
    begin = len(STATE_TOPICS) - 1
    chosen, others = ([(each.topic, each.stamp) for each in part] for part in early.messages())
    assert chosen == [each for each in received if each[1] >= begin]
    assert others == [each for each in received if each[1] < begin]


def test_a_command_that_answers_the_first_tick_is_kept() -> None:
    early = StartSynchronisation()
    for topic in (JOINT_DELTA, *STATE_TOPICS):
        early.add(EarlyMessage(topic, 0, 20, b""))
    assert early.is_ready()
    assert len(early.messages()[0]) == 1 + len(STATE_TOPICS)


def test_a_topic_on_which_nothing_comes_is_not_waited_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    early = StartSynchronisation()
    assert not early.is_ready()
    early.add(EarlyMessage(JOINT_STATES, 0, 20, b""))
    assert not early.is_ready()
    monkeypatch.setattr(start_synchronisation, "START_TIMEOUT", 0.01)
    time.sleep(0.02)
    assert early.is_ready()
    assert [each.stamp for each in early.messages()[0]] == [20]
