"""A bag in which the descriptions change: what belongs to which, told by hand for each way in which it came about."""

import logging
from dataclasses import replace

import pytest
from rled_msgs_py.bags import Bag, BagError, BagWriter, drop, merge, review, trim
from rled_msgs_py.bags.splitting import split
from rled_msgs_py.records import Text

from rled_msgs_py import topics

from .samples import PERIOD, TASK, URDF, descriptions, tick

OTHER = replace(TASK, max_steps=50)
ROBOT = "<robot name='another'/>"


def entries(first, last):
    return [entry for k in range(first, last) for entry in tick(k)]


def told(task):
    return [(topics.TASK_DESCRIPTION, Text(task if isinstance(task, str) else task.to_json()))]


def robot(text):
    return [(topics.ROBOT_DESCRIPTION, Text(text))]


def write(path, found):
    with BagWriter(path) as bag:
        for topic, record in found:
            bag.write(topic, record)
    return path


def steps(bag):
    return [each.status.step for each in bag.ticks()]


BEFORE, AFTER, STRAY = entries(0, 40), entries(0, 30), replace(TASK, robot="x")
RESTARTS = {
    "the description comes before the first tick": [*BEFORE, *robot(URDF), *told(OTHER), *AFTER],
    "the description comes after the first ticks": [*BEFORE, *AFTER[:15], *told(OTHER), *AFTER[15:]],
    "the description is filed before the last tick": [*BEFORE[:-5], *told(OTHER), *BEFORE[-5:], *AFTER],
    "the old description comes again": [*BEFORE[:99], *told(TASK), *BEFORE[99:], *told(OTHER), *AFTER],
    "a stray one comes before": [*BEFORE[:99], *told(STRAY), *BEFORE[99:], *told(OTHER), *AFTER],
}


@pytest.mark.parametrize("found", RESTARTS.values(), ids=RESTARTS.keys())
def test_a_restart_with_another_description_begins_a_part(tmp_path, found):
    path = write(tmp_path / "bag", [*descriptions(), *found])
    one, other = Bag(path, 1), Bag(path, 2)
    assert (one.parts, one.task, steps(one)) == (2, TASK, list(range(40)))
    assert (other.parts, other.task, steps(other)) == (2, OTHER, list(range(30)))
    assert one.robot_description == other.robot_description == URDF
    assert [len(review(bag).faults) for bag in (one, other)] == [0, 0]
    assert [bag.counts["task_description"] for bag in (one, other)] == [1, 1]
    for name in ("joint_states", "joint_delta"):
        assert one.counts[name] + other.counts[name] == 70


@pytest.mark.parametrize("last", [20, 45, 200])
def test_a_restart_after_a_short_run_is_found(tmp_path, last):
    found = [*descriptions(), *entries(0, last), *told(OTHER), *entries(0, 100)]
    path = write(tmp_path / "bag", found)
    assert (steps(Bag(path, 1)), steps(Bag(path, 2))) == (list(range(last)), list(range(100)))


def test_another_robot_begins_a_part_too(tmp_path):
    path = write(tmp_path / "bag", [*descriptions(), *entries(0, 9), *robot(ROBOT), *told(TASK), *entries(0, 5)])
    assert [Bag(path, part).robot_description for part in (1, 2)] == [URDF, ROBOT]
    assert [len(steps(Bag(path, part))) for part in (1, 2)] == [9, 5]


def test_a_restart_whose_stamps_go_on_is_seen_by_its_counters(tmp_path):
    later = [(topic, replace(record, stamp=record.stamp + 100 * PERIOD)) for topic, record in entries(0, 30)]
    path = write(tmp_path / "bag", [*descriptions(), *entries(0, 40), *told(OTHER), *later])
    assert (steps(Bag(path, 1)), steps(Bag(path, 2))) == (list(range(40)), list(range(30)))


def test_three_descriptions_are_three_parts(tmp_path):
    third = replace(TASK, tolerance=0.5)
    found = [*descriptions(), *entries(0, 9), *told(OTHER), *entries(0, 8), *told(third), *entries(0, 7)]
    path = write(tmp_path / "bag", found)
    assert [(Bag(path, part).task, len(steps(Bag(path, part)))) for part in (1, 2, 3)] == [
        (TASK, 9),
        (OTHER, 8),
        (third, 7),
    ]


@pytest.mark.parametrize("late", [100, 300, 499])
def test_a_description_that_comes_late_is_that_of_its_own_simulation(tmp_path, late):
    begun = [*descriptions(), *entries(0, 40), *told(OTHER), *entries(0, 30)]
    found = [*begun, *entries(0, late), *told(TASK), *entries(late, 600)]
    path = write(tmp_path / "bag", found)
    assert [(Bag(path, part).task, len(steps(Bag(path, part)))) for part in (1, 2, 3)] == [
        (TASK, 40),
        (OTHER, 30),
        (TASK, 600),
    ]


@pytest.mark.parametrize("place", [0, 30, 79])
@pytest.mark.parametrize("stray", [OTHER, "{}", "[" * 100, replace(TASK, robot="other", joint_names=("a", "b"))])
def test_a_stray_description_is_passed_over(tmp_path, place, stray, caplog):
    text = told(stray)
    with caplog.at_level(logging.WARNING):
        bag = Bag(write(tmp_path / "bag", [*descriptions(), *entries(0, place), *text, *entries(place, 80)]))
    assert (bag.parts, bag.task, steps(bag)) == (1, TASK, list(range(80)))
    assert "task_description that does not belong to the recording is passed over" in caplog.text
    assert review(bag).faults == []


def test_a_description_that_is_not_valid_does_not_take_the_first_place(tmp_path):
    bag = Bag(write(tmp_path / "bag", [*told("{}"), *descriptions(), *entries(0, 20)]))
    assert (bag.task, bag.parts) == (TASK, 1)


def test_the_same_description_again_is_no_change(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        bag = Bag(write(tmp_path / "bag", [*descriptions(), *entries(0, 9), *descriptions(), *entries(0, 5)]))
    assert (bag.parts, bag.note, caplog.text, len(steps(bag))) == (1, "", "", 14)


def test_a_second_simulation_that_waits_at_its_first_tick_is_no_restart(tmp_path):
    found = [*descriptions(), *entries(0, 40), *told(OTHER), *tick(0)[:4], *entries(40, 80)]
    bag = Bag(write(tmp_path / "bag", found))
    assert (bag.parts, bag.task) == (1, TASK)
    assert set(steps(bag)) == set(range(80))


@pytest.mark.parametrize("topic", [topics.JOINT_STATES, topics.EE_POSE, topics.TASK_STATUS], ids=lambda each: each.name)
def test_a_burst_of_somebody_else_on_one_topic_is_no_restart(tmp_path, topic):
    burst = [entry for entry in entries(0, 20) if entry[0] == topic]
    if topic == topics.TASK_STATUS:
        burst = [(topic, replace(record, episode=9)) for _, record in burst]
    bag = Bag(write(tmp_path / "bag", [*descriptions(), *entries(0, 90), *burst, *told(OTHER), *entries(90, 180)]))
    assert (bag.parts, bag.task) == (1, TASK)


def test_every_tool_goes_on_with_a_part(tmp_path):
    path = write(tmp_path / "bag", [*descriptions(), *entries(0, 40), *told(OTHER), *entries(0, 30)])
    trim(Bag(path, 2), tmp_path / "second", 0.1, 0.3, lambda _: None)
    assert (steps(Bag(tmp_path / "second")), Bag(tmp_path / "second").task) == (list(range(5, 15)), OTHER)
    trim(Bag(path), tmp_path / "first", 0.0, 10.0, lambda _: None)
    merge([Bag(path), Bag(tmp_path / "first")], tmp_path / "both", lambda _: None)
    assert len(steps(Bag(tmp_path / "both"))) == 80
    with pytest.raises(BagError, match="no episode 1"):
        drop(Bag(path), tmp_path / "dropped", [1], lambda _: None)
    with pytest.raises(BagError, match="no part 3; accepted: 1 to 2"):
        Bag(path, 3)


def test_a_split_bag_is_one_bag_for_each_part_and_loses_no_message(tmp_path):
    found = [*descriptions(), *entries(0, 40), *told("{}"), *told(OTHER), *entries(0, 30)]
    path = write(tmp_path / "bag", found)
    write(tmp_path / "bag_2", entries(0, 1))
    assert split(path) == [path, tmp_path / "bag_3"]
    bags = [Bag(each) for each in split(path)] + [Bag(tmp_path / "bag_3")]
    assert [(bag.note, bag.parts, bag.task, steps(bag)) for bag in bags] == [
        ("", 1, TASK, list(range(40))),
        ("", 1, OTHER, list(range(30))),
    ]
    assert sum(bag.message_count for bag in bags) == len(found) - 1 + 1  # less the stray one; one robot, told to both


def test_a_split_bag_keeps_messages_of_any_time(tmp_path):
    late = [(topics.EE_POSE, replace(tick(0)[1][1], stamp=(2**31 - 1) * 1_000_000_000))]
    path = write(tmp_path / "bag", [*descriptions(), *entries(0, 40), *late, *told("{}"), *entries(40, 80)])
    split(path)
    assert Bag(path).message_count == 2 + 80 * 5 + 1


def test_a_bag_without_a_change_is_not_split(tmp_path):
    path = write(tmp_path / "bag", [*descriptions(), *entries(0, 4)])
    before = (path / "bag_0.mcap").read_bytes()
    assert split(path) == [path]
    assert (path / "bag_0.mcap").read_bytes() == before
