"""Records become messages and come back, with rclpy's message classes and with those of the bag library."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from hypothesis import given
from rclpy.serialization import deserialize_message, serialize_message
from rled_msgs_py.errors import ContractError
from rled_msgs_py.records import (
    Actor,
    DeltaCommand,
    GateCode,
    GateDecision,
    JointSample,
    Level,
    PoseSample,
    TaskStatus,
    Text,
)
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, from_msg, qos_profile, to_msg
from rled_msgs_py.topics import (
    DIAGNOSTICS,
    EE_POSE,
    JOINT_DELTA,
    JOINT_STATES,
    RECORDED,
    ROBOT_DESCRIPTION,
    SAFETY_GATE,
    TASK_STATUS,
)
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from rled_msgs_py import messages

from .samples import ENTRIES, same


@given(ENTRIES)
def test_records_survive_messages_of_rclpy(entry):
    topic, record = entry
    message = to_msg(record)
    assert type(message) is MESSAGE_CLASSES[topic.type]
    assert same(from_msg(topic, message), record)


@given(ENTRIES)
def test_records_survive_the_bytes_of_a_bag(entry):
    topic, record = entry
    assert same(messages.decode(topic, messages.encode(topic, record)), record)


@given(ENTRIES)
def test_rclpy_reads_the_bytes_of_a_bag(entry):
    topic, record = entry
    message = deserialize_message(messages.encode(topic, record), MESSAGE_CLASSES[topic.type])
    assert message == to_msg(record)
    assert same(from_msg(topic, message), record)


@given(ENTRIES)
def test_the_bytes_of_rclpy_are_read_like_those_of_a_bag(entry):
    topic, record = entry
    assert same(messages.decode(topic, serialize_message(to_msg(record))), record)


PADDED = [
    (
        JOINT_STATES,
        JointSample(12_345_678_901, ("abc", "abd"), [1.0, -2.5], [0.0, 1e-300]),
        [17, 18, 19, *range(64, 68)],
    ),
    (JOINT_DELTA, DeltaCommand(7, ("abc", "abd"), [1.0, -2.5]), [17, 18, 19]),
    (EE_POSE, PoseSample(5, "abc", [1.0, 2.0, 3.0]), []),
    (ROBOT_DESCRIPTION, Text("<robot name='abc'/>"), []),
]


def test_bytes_equal_those_of_rclpy_apart_from_padding():
    for topic, record, padding in PADDED:
        ours, theirs = messages.encode(topic, record), bytearray(serialize_message(to_msg(record)))
        for place in padding:
            theirs[place] = 0
        assert theirs[: len(ours)] == ours


def test_bytes_of_a_delta_are_as_the_cdr_rules_say():
    expected = bytes.fromhex(
        "00010000"  # plain CDR, little endian
        "0c000000 e8030000"  # 12 s, 1000 ns
        "01000000 00 000000"  # empty frame and three bytes to the next multiple of 4
        "01000000 02000000 7100 0000"  # one name, "q"
        "01000000 000000000000e03f"  # one position, 0.5, at a multiple of 8 after the first four bytes
        "00000000 00000000"  # no velocity, no effort
    )
    assert messages.encode(JOINT_DELTA, DeltaCommand(12_000_001_000, ("q",), [0.5])) == expected


def test_a_delta_travels_as_position_without_velocity():
    message = to_msg(DeltaCommand(0, ("a", "b"), [0.1, -0.2]))
    assert (list(message.name), list(message.position)) == (["a", "b"], [0.1, -0.2])
    assert len(message.velocity) == len(message.effort) == 0


def test_names_are_those_of_each_message_whatever_came_before():
    for names in (("a", "b"), ("a", "b"), ("a", "c"), ("a", "b", "c"), ("ab", "b"), ("a", "b")):
        sent = DeltaCommand(0, names, np.zeros(len(names)))
        assert messages.decode(JOINT_DELTA, messages.encode(JOINT_DELTA, sent)).names == names


def test_joint_states_without_velocity_are_at_rest():
    message = JointState(name=["a", "b"], position=[1.0, 2.0])
    assert from_msg(JOINT_STATES, message).velocity.tolist() == [0.0, 0.0]


def test_numbers_of_a_status_are_key_values_that_plot():
    message = to_msg(TaskStatus(0, 1, 2, -0.25, 3, True, 4, False, True))
    values = {pair.key: float(pair.value) for pair in message.status[0].values}
    expected = {"episode": 1, "step": 2, "reward": -0.25, "targets_reached": 3, "risky": 1, "violations": 4}
    assert values == expected | {"terminated": 0, "truncated": 1}
    assert message.status[0].level == DiagnosticStatus.WARN


def test_numpy_numbers_travel_as_numbers():
    status = TaskStatus(np.int64(3), np.int64(1), 2, np.float64(-0.25), 3, np.True_, 4, np.False_, False)
    assert from_msg(TASK_STATUS, to_msg(status)) == TaskStatus(3, 1, 2, -0.25, 3, True, 4, False, False)


def test_a_message_with_nan_or_infinity_is_refused():
    for bad in [float("nan"), float("inf")]:
        with pytest.raises(ContractError, match="finite numbers"):
            from_msg(JOINT_DELTA, JointState(name=["a"], position=[bad]))
        pose = PoseStamped()
        pose.pose.position.x = bad
        with pytest.raises(ContractError, match="finite numbers"):
            from_msg(EE_POSE, pose)


def test_a_message_whose_names_do_not_fit_is_refused():
    for names in [[], ["a", "a"], ["a", ""], ["a"], ["a", "b", "c"]]:
        with pytest.raises(ContractError):
            from_msg(JOINT_DELTA, JointState(name=names, position=[0.0, 0.0]))


def test_a_stamp_that_is_no_time_is_refused():
    for sec, nanosec in [(-1, 0), (0, 1_000_000_000), (0, 2**32 - 1)]:
        message = JointState(name=["a"], position=[0.0])
        message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        with pytest.raises(ContractError, match="stamp"):
            from_msg(JOINT_DELTA, message)


def test_a_stamp_that_a_message_cannot_say_is_refused():
    for stamp in [-1, 2**31 * 10**9]:
        with pytest.raises(ContractError, match=f"stamp of {stamp} ns"):
            to_msg(DeltaCommand(stamp, ("a",), [0.0]))


def diagnostic(level=DiagnosticStatus.OK, message="ok", **values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(status=[DiagnosticStatus(level=level, name="n", message=message, values=pairs)])


def test_a_status_with_another_kind_of_value_is_refused():
    for field, value in [
        ("step", "-1"),
        ("step", "1.5"),
        ("step", "nan"),
        ("step", "9" * 19),
        ("step", "9" * 5000),
        ("episode", "²"),
        ("risky", "2"),
        ("reward", "much"),
    ]:
        message = to_msg(TaskStatus(0, 1, 2, -0.25, 3, True, 4, False, True))
        next(pair for pair in message.status[0].values if pair.key == field).value = value
        with pytest.raises(ContractError, match=f"'{value[:20]}.*' in a status"):
            from_msg(TASK_STATUS, message)


def test_a_status_without_a_value_is_refused_naming_it():
    keys = ("step", "targets_reached", "risky", "violations", "terminated", "truncated")
    message = diagnostic(**dict.fromkeys(keys, "0"))
    with pytest.raises(ContractError, match="lacks episode, reward"):
        from_msg(TASK_STATUS, message)


def test_an_array_of_other_than_one_status_is_refused():
    for count in [0, 2]:
        with pytest.raises(ContractError, match=f"{count} statuses"):
            from_msg(DIAGNOSTICS, DiagnosticArray(status=[DiagnosticStatus()] * count))


def test_a_stale_status_is_refused():
    with pytest.raises(ContractError, match="diagnostic level 3"):
        from_msg(DIAGNOSTICS, diagnostic(level=DiagnosticStatus.STALE))


def test_a_decision_of_nobody_is_refused():
    for message in ["", "agent", "somebody: because"]:
        with pytest.raises(ContractError, match="gate message"):
            from_msg(SAFETY_GATE, diagnostic(message=message))


def test_a_decision_says_who_acts_and_why():
    figures = 0.5, math.nan, "qcd", 1, 2, GateCode.UNSURE
    decision = GateDecision(1, Level.WARN, Actor.EXPERT, "uncertain: u >= ξ", *figures)
    message = to_msg(decision)
    assert message.status[0].message == "expert: uncertain: u >= ξ"
    back = from_msg(SAFETY_GATE, message)
    assert (back.actor, back.reason, back.uncertainty) == (Actor.EXPERT, "uncertain: u >= ξ", 0.5)
    assert back.code is GateCode.UNSURE
    assert math.isnan(back.threshold)


def test_a_record_of_another_kind_than_the_topic_is_refused():
    with pytest.raises(ContractError, match="a PoseSample for joint_states; accepted: a record of sensor_msgs"):
        messages.encode(JOINT_STATES, PoseSample(0, "world", np.zeros(3)))


@given(ENTRIES)
def test_bytes_that_break_off_are_refused(entry):
    topic, record = entry
    data = messages.encode(topic, record)
    for size in range(len(data) - 4):
        with pytest.raises(ContractError):
            messages.decode(topic, data[:size])


def test_big_endian_bytes_are_read():
    store = get_typestore(Stores.ROS2_JAZZY)
    command = DeltaCommand(7, ("a", "b"), [1.0, -2.5])
    message = store.deserialize_cdr(messages.encode(JOINT_DELTA, command), JOINT_DELTA.type)
    data = bytes(store.serialize_cdr(message, JOINT_DELTA.type, little_endian=False))
    assert data[:2] == b"\0\0"
    assert same(messages.decode(JOINT_DELTA, data), command)


def test_another_encoding_is_refused():
    for head in ["0003", "0006", "0100", ""]:
        data = bytes.fromhex(head) + messages.encode(JOINT_DELTA, DeltaCommand(7, ("a",), [1.0]))[len(head) // 2 :]
        with pytest.raises(ContractError, match=r"encoding|no sensor_msgs"):
            messages.decode(JOINT_DELTA, data if head else b"")


def test_quality_of_service_reaches_rclpy():
    for topic in RECORDED:
        profile = qos_profile(topic.qos)
        assert profile.depth == topic.qos.depth
        assert profile.reliability.name.lower() == topic.qos.reliability
        assert profile.durability.name.lower() == topic.qos.durability


def test_a_text_is_taken_as_it_is():
    assert from_msg(ROBOT_DESCRIPTION, String(data="<robot/>")) == Text("<robot/>")
