"""Which messages a player calls due, and how a bag says its quality of service."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.bags.metadata import qos_profiles
from rled_msgs_py.bags.storage import BagTopic
from rled_msgs_py.errors import RledError
from rled_msgs_py.topics import RECORDED, Qos
from rled_teleop.nodes.replay_demos import replayed
from rled_teleop.recording.bag_messages import quality, read_recording
from rled_teleop.recording.player import Player

TIMES = np.array([5, 5, 7, 10]) * 1_000_000_000


def test_messages_come_due_at_their_times():
    player = Player(TIMES, rate=1.0, loop=False, now=100.0)
    assert list(player.due(100.0)) == [0, 1]
    assert list(player.due(101.9)) == []
    assert list(player.due(102.0)) == [2]
    assert not player.finished
    assert list(player.due(200.0)) == [3]
    assert player.finished


def test_a_rate_makes_time_run_faster():
    player = Player(TIMES, rate=10.0, loop=False, now=0.0)
    assert list(player.due(0.5)) == [0, 1, 2, 3]


def test_a_pause_stands_still():
    player = Player(TIMES, rate=1.0, loop=False, now=0.0)
    assert list(player.pause(True, 1.0)) == [0, 1]
    assert list(player.due(50.0)) == []
    assert list(player.pause(False, 60.0)) == []
    assert list(player.due(61.0)) == [2]


def test_a_loop_begins_again():
    player = Player(TIMES, rate=1.0, loop=True, now=0.0)
    assert list(player.due(6.0)) == [0, 1, 2, 3]
    assert list(player.due(6.1)) == [0, 1]
    assert not player.finished


@given(st.lists(st.floats(0.0, 3.0), max_size=30), st.floats(0.1, 5.0))
def test_every_message_is_due_once_and_in_order(waits, rate):
    player, now, seen = Player(TIMES, rate, loop=False, now=0.0), 0.0, []
    for wait in [*waits, 100.0]:
        now += wait
        seen += player.due(now)
    assert seen == [0, 1, 2, 3]


def bag_topic(qos):
    return BagTopic("/a", "std_msgs/msg/String", "cdr", "", "ros2msg", "", qos)


def test_quality_of_service_is_read_back():
    for topic in RECORDED:
        assert quality(bag_topic(qos_profiles(topic.qos))) == topic.qos


def test_an_unreadable_quality_is_the_default():
    for text in ["", "- {}", "][", "- {depth: x, reliability: 1, durability: 1}"]:
        assert quality(bag_topic(text)) == Qos(10)


def test_numbers_of_older_bags_are_understood():
    assert quality(bag_topic("- {depth: 1, reliability: 2, durability: 1}")) == Qos(1, "best_effort", "transient_local")


def test_a_history_is_made_longer_but_not_that_of_descriptions():
    assert replayed(Qos(1)).depth == 1000
    assert replayed(Qos(1, durability="transient_local")).depth == 1


def test_a_part_of_a_bag_is_cut_by_time_and_keeps_its_descriptions(planar_bag):
    whole = read_recording(planar_bag)
    middle = whole.between(0.5, 1.0)
    assert 0 < len(middle.data) < len(whole.data)
    assert (middle.times - whole.times[0]).min() >= 0.5e9
    assert (middle.times - whole.times[0]).max() <= 1.0e9
    latched = [whole.topics[place].name for place in whole.latched_before(0.5).topic]
    assert sorted(latched) == ["/robot_description", "/task_description"]
    assert whole.between(0.0, 0.0).data == whole.data


def test_a_missing_bag_is_refused(tmp_path):
    with pytest.raises(RledError, match="does not exist"):
        read_recording(tmp_path / "gone")
