"""Each kind of fault, put into a small recording on purpose, is found where it was put and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from rled_msgs_py.bags import Bag, BagWriter, review
from rled_msgs_py.bags.faults import CLOCK_JUMP, INVALID, LOST, NO_ORDER, RENAMED, STOPS, TWO_PUBLISHERS
from rled_msgs_py.bags.header import moved, stamp_of
from rled_msgs_py.bags.stamps import fallen_back, going_on, interleaved
from rled_msgs_py.records import JointSample, Text

from rled_msgs_py import topics

from .samples import NAMES, PERIOD, descriptions, tick

TICKS = 80
STATES = {"joint_states", "ee_pose", "target_pose", "task_status"}


def entries(first=0, last=TICKS):
    return [entry for k in range(first, last) for entry in tick(k)]


def later(found, shift):
    return [(topic, replace(record, stamp=record.stamp + shift)) for topic, record in found]


def without(found, name, first, last):
    return [each for each in found if each[0].name != name or not first <= each[1].stamp // PERIOD < last]


def reviewed(tmp_path, found):
    path = tmp_path / "bag"
    with BagWriter(path) as bag:
        for topic, record in [*descriptions(), *found]:
            bag.write(topic, record)
    return review(Bag(path))


def only(found):
    (fault,) = found.faults
    return fault


def test_a_sound_recording_has_no_faults(tmp_path):
    assert reviewed(tmp_path, entries()).faults == []


def test_a_restarted_simulation_is_stamps_going_backwards(tmp_path):
    found = reviewed(tmp_path, entries(0, 40) + entries(0, 30))
    fault = only(found)
    assert (fault.kind, set(fault.topics)) == (NO_ORDER, {*STATES, "joint_delta"})
    assert fault.what == "the stamp falls back by 0.780 s"
    assert found.seconds(fault.first) == pytest.approx(39 * 0.02)
    assert len(found.timeline.moments) == 70


def test_a_clock_set_back_while_the_steps_go_on_is_a_clock_jump(tmp_path):
    fault = only(reviewed(tmp_path, entries(0, 40) + later(entries(40, 70), -20 * PERIOD)))
    assert (fault.kind, fault.what) == (CLOCK_JUMP, "the stamp falls back by 0.380 s")


def test_a_clock_set_ahead_while_the_steps_go_on_is_a_clock_jump(tmp_path):
    found = reviewed(tmp_path, entries(0, 40) + later(entries(40), 100 * PERIOD))
    fault = only(found)
    assert (fault.kind, fault.what) == (CLOCK_JUMP, "the stamp jumps ahead by 2.020 s within one step")
    assert found.seconds(fault.first) == pytest.approx(39 * 0.02)
    assert found.episodes_of(fault) == [0]


def test_ticks_that_are_missing_on_all_topics_are_lost_messages(tmp_path):
    fault = only(reviewed(tmp_path, entries(0, 40) + entries(43)))
    assert (fault.kind, fault.what) == (LOST, "3 ticks are missing: the step counter jumps")
    assert (fault.first, fault.last) == (39 * PERIOD, 43 * PERIOD)


@pytest.mark.parametrize("name", sorted(STATES))
def test_messages_missing_on_one_topic_are_lost(tmp_path, name):
    faults = reviewed(tmp_path, without(entries(), name, 20, 23)).faults
    assert next(fault for fault in faults if fault.topics == (name,))[:4] == (LOST, (name,), 20 * PERIOD, 22 * PERIOD)
    assert all(fault.kind == LOST for fault in faults)


@pytest.mark.parametrize("name", [*sorted(STATES), "joint_delta"])
@pytest.mark.parametrize("last", [60, TICKS])
def test_a_topic_that_says_nothing_for_half_a_second_has_stopped(tmp_path, name, last):
    faults = reviewed(tmp_path, without(entries(), name, 30, last)).faults
    stopped = [fault for fault in faults if fault.kind == STOPS]
    assert [fault.topics for fault in stopped] == [(name,)]
    assert stopped[0].first == 30 * PERIOD
    assert all(fault.kind in (STOPS, LOST) for fault in faults)


def test_two_publishers_at_the_same_stamps_are_found(tmp_path):
    q = np.array([0.3, 0.9])
    second = [(topics.JOINT_STATES, JointSample(k * PERIOD, NAMES, q, q)) for k in range(20, 40)]
    both = sorted(entries() + second, key=lambda entry: entry[1].stamp)
    fault = only(reviewed(tmp_path, both))
    assert (fault.kind, fault.topics) == (TWO_PUBLISHERS, ("joint_states",))
    assert (fault.first, fault.last) == (20 * PERIOD, 39 * PERIOD)


def test_two_publishers_with_clocks_of_their_own_are_found(tmp_path):
    other = [entry for entry in later(entries(), 5_000_000_007) if entry[0] == topics.JOINT_STATES]
    both = [each for k in range(TICKS) for each in (*tick(k), other[k])]
    kinds = {fault.kind for fault in reviewed(tmp_path, both).faults if "joint_states" in fault.topics}
    assert kinds == {TWO_PUBLISHERS}


def test_two_publishers_that_take_turns_within_a_tick_are_found(tmp_path):
    other = JointSample(0, NAMES, np.array([2.0, 2.0]), np.zeros(2))
    between = [(topics.JOINT_STATES, replace(other, stamp=k * PERIOD + PERIOD // 2)) for k in range(TICKS)]
    both = [each for k in range(TICKS) for each in (*tick(k), between[k])]
    assert TWO_PUBLISHERS in {fault.kind for fault in reviewed(tmp_path, both).faults}


def test_a_message_twice_is_no_second_publisher(tmp_path):
    assert reviewed(tmp_path, [each for k in range(TICKS) for each in (*tick(k), tick(k)[0])]).faults == []


def test_joint_names_that_change_midway_are_found(tmp_path):
    found = [
        (topic, replace(record, names=("shoulder", "wrist")) if topic == topics.JOINT_STATES and k >= 50 else record)
        for k in range(TICKS)
        for topic, record in tick(k)
    ]
    faults = reviewed(tmp_path, found).faults
    (fault,) = [each for each in faults if each.kind == RENAMED]
    assert fault.topics == ("joint_states",)
    assert (fault.first, fault.last) == (50 * PERIOD, 79 * PERIOD)
    assert fault.what == "message 50 is of shoulder, wrist: it lacks elbow (and 29 more)"


def test_a_message_that_is_not_valid_is_found(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as bag:
        for topic, record in [*descriptions(), *entries(0, 30)]:
            bag.write(topic, record)
        bag.write_cdr(topics.JOINT_STATES, b"\x00\x01\x00\x00nonsense", 29 * PERIOD)
        for topic, record in entries(30):
            bag.write(topic, record)
    (fault,) = review(Bag(path)).faults
    assert (fault.kind, fault.topics, fault.first) == (INVALID, ("joint_states",), 29 * PERIOD)


def test_a_part_taken_out_on_purpose_is_no_fault(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path, metadata={"cuts": f"[[{39 * PERIOD}, {60 * PERIOD}]]"}) as bag:
        for topic, record in [*descriptions(), *entries(0, 40), *entries(60)]:
            bag.write(topic, record)
    assert review(Bag(path)).faults == []


def event(name, number, k):
    text = f'{{"event": "{name}", "episode": {number}, "stamp": {k * PERIOD}}}'
    return [(topics.EPISODE_EVENTS, Text(text))]


def test_a_pause_between_two_episodes_is_no_fault_and_a_loss_within_one_is(tmp_path):
    first = [*event("start", 0, 9), *entries(10, 30), *event("stop", 0, 29)]
    second = [*event("start", 1, 49), *entries(50, 60), *entries(63, 70), *event("stop", 1, 69)]
    found = reviewed(tmp_path, first + second)
    fault = only(found)
    assert (fault.kind, fault.first, fault.last) == (LOST, 59 * PERIOD, 63 * PERIOD)
    assert found.episodes_of(fault) == [1]


def test_stamps_go_on_where_they_begin_anew():
    stamps = np.array([5, 6, 7, 0, 1, 2])
    assert fallen_back(stamps).tolist() == [False, False, False, True, False, False]
    assert going_on(stamps).tolist() == [5, 6, 7, 8, 9, 10]


def test_a_stamp_that_is_made_good_at_once_is_out_of_turn_only():
    stamps = np.array([0, 40, 20, 60])
    assert interleaved(stamps).tolist() == [False, False, True, False]
    assert not fallen_back(stamps).any()


def test_a_message_is_moved_in_time_and_otherwise_the_same(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as bag:
        for topic, record in [*tick(3), (topics.ROBOT_DESCRIPTION, Text("x"))]:
            bag.write(topic, record)
    bag = Bag(path)
    for message in bag.messages():
        name = bag.name_of(message)
        data = moved(name, message.topic.type, message.data, 2_500_000_000)
        if name == "robot_description":
            assert data == message.data
        else:
            assert stamp_of(message.topic.type, data) == 3 * PERIOD + 2_500_000_000
            assert moved(name, message.topic.type, data, -2_500_000_000) == message.data
