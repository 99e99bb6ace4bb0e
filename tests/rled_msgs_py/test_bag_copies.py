"""Trimmed, shortened and merged bags hold exactly the messages that they should, byte for byte; stamps move."""

import json

import numpy as np
import pytest
from rled_msgs_py.bags import Bag, BagError, BagWriter, drop, merge, review, trim
from rled_msgs_py.bags.header import moved, sim_stamp, stamp_of
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import LATEST, encode
from rled_msgs_py.records import JointSample, Text
from rled_msgs_py.topics import JOINT_STATES

from rled_msgs_py import topics

from .samples import NAMES, PERIOD, descriptions, recording, tick, write_bag
from .test_bag_quality import STRAIGHT, event, state, ticks


def silent(_):
    pass


def messages(path):
    bag = Bag(path)
    return [(bag.name_of(each), each.data) for each in bag.messages()]


def stamps(path, name="joint_states"):
    topic = next(each for each in topics.RECORDED if each.name == name)
    return [stamp_of(each.topic.type, each.data) // PERIOD for each in Bag(path).messages(topic)]


@pytest.fixture
def bag(tmp_path):
    return Bag(write_bag(tmp_path / "bag", ticks=50, metadata={"operator": "ada"}))


@pytest.fixture
def three(tmp_path):
    """Three targets reached one after the other, eight ticks each."""
    found, k, q = [], 0, (0.0, 0.5)
    for reached in range(3):
        part, k, q = ticks(STRAIGHT, k, 0, reached, q, (0.1 * reached, 0.2))
        found += part
    with BagWriter(tmp_path / "three") as writer:
        for topic, record in [*descriptions(), *found, *state(k, q, (0.9, 0.9), 0, 3)]:
            writer.write(topic, record)
    return Bag(tmp_path / "three")


def test_a_trimmed_bag_holds_the_stretch_and_the_descriptions(bag, tmp_path):
    assert trim(bag, tmp_path / "part", 0.2, 0.4, silent) == 2 + 5 * 10
    assert stamps(tmp_path / "part") == list(range(10, 20))
    assert set(messages(tmp_path / "part")) <= set(messages(bag.path))
    part = Bag(tmp_path / "part")
    assert (part.task, part.robot_description, part.metadata) == (bag.task, bag.robot_description, bag.metadata)


def test_a_bag_trimmed_to_everything_is_the_same_bag(bag, tmp_path):
    trim(bag, tmp_path / "same", float("-inf"), float("inf"), silent)
    assert messages(tmp_path / "same") == messages(bag.path)


def test_a_bag_is_cut_where_the_simulation_was_restarted(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for topic, record in [*descriptions(), *(each for k in (*range(30), *range(20)) for each in tick(k))]:
            writer.write(topic, record)
    bag = Bag(tmp_path / "bag")
    (fault,) = review(bag).faults
    at = review(bag).seconds(fault.last)
    trim(bag, tmp_path / "before", float("-inf"), at, silent)
    trim(bag, tmp_path / "after", at, float("inf"), silent)
    assert (stamps(tmp_path / "before"), stamps(tmp_path / "after")) == (list(range(30)), list(range(20)))
    assert not review(Bag(tmp_path / "before")).faults + review(Bag(tmp_path / "after")).faults


def test_nothing_is_written_when_nothing_is_left(bag, tmp_path):
    with pytest.raises(BagError, match=r"nothing of .* is left"):
        trim(bag, tmp_path / "part", 100.0, 200.0, silent)
    assert {each.name for each in tmp_path.iterdir()} == {"bag"}


def test_what_is_there_is_replaced_only_when_asked(bag, tmp_path):
    trim(bag, tmp_path / "part", 0.2, 0.4, silent)
    with pytest.raises(BagError, match="part exists"):
        trim(bag, tmp_path / "part", 0.0, 0.2, silent)
    assert stamps(tmp_path / "part") == list(range(10, 20))
    trim(bag, tmp_path / "part", 0.0, 0.2, silent, overwrite=True)
    assert stamps(tmp_path / "part") == list(range(10))


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_dropped_episode_is_gone_and_the_others_are_as_they_were(three, tmp_path, number):
    drop(three, tmp_path / "rest", [number], silent)
    before, after = review(three), review(Bag(tmp_path / "rest"))
    left = [quality for each, quality in enumerate(before.qualities) if each != number]
    assert [quality[:4] for quality in after.qualities] == [quality[:4] for quality in left]
    assert after.faults == []
    assert set(messages(tmp_path / "rest")) <= set(messages(three.path))


def test_all_episodes_but_one_can_be_dropped(three, tmp_path):
    drop(three, tmp_path / "one", [0, 2], silent)
    (episode,) = review(Bag(tmp_path / "one")).episodes
    assert (episode.first, episode.last) == (8 * PERIOD, 16 * PERIOD)


def test_an_unknown_episode_is_refused(three, tmp_path):
    with pytest.raises(BagError, match=r"no episode 3; accepted: 0 to 2"):
        drop(three, tmp_path / "rest", [1, 3], silent)
    assert not (tmp_path / "rest").exists()


def test_an_episode_told_by_events_is_dropped_with_its_events(tmp_path):
    first, k, q = ticks(STRAIGHT)
    second, k, q = ticks(STRAIGHT, k, 0, 1, q, (0.9, 0.9))
    told = [event("start", 0, 0), event("stop", 0, 7), event("start", 1, 8), event("stop", 1, 15)]
    with BagWriter(tmp_path / "bag") as writer:
        for topic, record in [*descriptions(), *first, *second, *told]:
            writer.write(topic, record)
    drop(Bag(tmp_path / "bag"), tmp_path / "rest", [0], silent)
    assert stamps(tmp_path / "rest") == list(range(8, 16))
    assert [episode.number for episode in review(Bag(tmp_path / "rest")).episodes] == [1]


def test_merged_bags_hold_all_messages_with_stamps_that_grow(three, tmp_path):
    merge([three, three], tmp_path / "both", silent)
    both = Bag(tmp_path / "both")
    found, one = review(both), review(three)
    assert both.counts["joint_states"] == 2 * three.counts["joint_states"]
    assert both.counts["task_description"] == 1
    assert found.faults == []
    assert [episode.number for episode in found.episodes] == list(range(6))
    assert [quality[:4] for quality in found.qualities] == [quality[:4] for quality in one.qualities * 2]
    assert (found.timeline.q[:25] == found.timeline.q[25:]).all()


def test_merging_keeps_what_is_discarded_and_who_drove(tmp_path):
    found, _k, _q = ticks(STRAIGHT)
    told = [event("start", 0, 0, operator="ada"), event("stop", 0, 7), event("discard", 0, 8)]
    for name in "ab":
        with BagWriter(tmp_path / name, metadata={"robot": "planar", "seed": name}) as writer:
            for topic, record in [*descriptions(), *told, *found]:
                writer.write(topic, record)
    merge([Bag(tmp_path / "a"), Bag(tmp_path / "b")], tmp_path / "both", silent)
    both = Bag(tmp_path / "both")
    episodes = review(both).episodes
    assert [(each.number, each.kept, each.operator) for each in episodes] == [(0, False, "ada"), (1, False, "ada")]
    assert set(both.metadata) == {"robot", "cuts"}
    assert len(json.loads(both.metadata["cuts"])) == 1


def test_bags_of_different_tasks_are_not_merged(three, tmp_path):
    with BagWriter(tmp_path / "other") as writer:
        for topic, record in [*descriptions()[1:], (topics.ROBOT_DESCRIPTION, Text("<robot name='other'/>")), *tick(0)]:
            writer.write(topic, record)
    with pytest.raises(BagError, match="differ in their robot_description"):
        merge([three, Bag(tmp_path / "other")], tmp_path / "both", silent)
    assert not (tmp_path / "both").exists()


def test_a_merged_bag_can_be_trimmed_dropped_and_merged_again(three, tmp_path):
    merge([three, three], tmp_path / "two", silent)
    drop(Bag(tmp_path / "two"), tmp_path / "five", [2], silent)
    merge([Bag(tmp_path / "five"), three], tmp_path / "eight", silent)
    trim(Bag(tmp_path / "eight"), tmp_path / "part", 0.1, 1.0, silent)
    assert review(Bag(tmp_path / "eight")).faults == review(Bag(tmp_path / "part")).faults == []
    assert len(review(Bag(tmp_path / "eight")).episodes) == 8


def sample(stamp):
    return JointSample(stamp, NAMES, np.zeros(2), np.zeros(2))


def test_a_stamp_moves_as_far_as_a_message_can_tell():
    for stamp, shift in [(0, LATEST - 1), (LATEST - 1, 0), (LATEST - 1, 1 - LATEST), (0, -LATEST)]:
        data = encode(JOINT_STATES, sample(stamp))
        later = moved(JOINT_STATES.name, JOINT_STATES.type, data, shift)
        assert sim_stamp(JOINT_STATES.name, JOINT_STATES.type, later) == stamp + shift


def test_a_stamp_that_no_message_can_tell_is_refused():
    for stamp, shift in [(0, LATEST), (LATEST - 1, 1), (0, -LATEST - 1)]:
        data = encode(JOINT_STATES, sample(stamp))
        with pytest.raises(ContractError, match=r"a stamp on joint_states of \d+ ns, to be moved by"):
            moved(JOINT_STATES.name, JOINT_STATES.type, data, shift)


def test_a_recording_behind_one_that_ends_at_the_last_stamp_is_refused(tmp_path):
    with BagWriter(tmp_path / "late") as bag:
        for topic, record in recording(2):
            bag.write(topic, record)
        bag.write(JOINT_STATES, sample(LATEST - 1))
    other = write_bag(tmp_path / "other", ticks=3)
    with pytest.raises(ContractError, match="to be moved by"):
        merge([Bag(tmp_path / "late"), Bag(other)], tmp_path / "merged", lambda _: None)
    assert not (tmp_path / "merged").exists()
