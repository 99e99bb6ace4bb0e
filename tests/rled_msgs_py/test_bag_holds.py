"""Ticks that repeat a step, as in real time, are no new target: episodes counted by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rled_msgs_py.bags import Bag, BagWriter, review, trim
from rled_msgs_py.bags.faults import LOST
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, TaskStatus

from rled_msgs_py import topics

from .samples import NAMES, PERIOD, descriptions

DELTA = np.array([0.05, 0.0])


def row(step, reached, answered=True, episode=0):
    """A tick: its step, the targets reached so far, whether somebody answers it."""
    return episode, step, reached, answered


def hold(step, reached, episode=0):
    return row(step, reached, False, episode)


def motion(first=0, targets=3, steps=6):
    """Ways of so many steps to targets, the last tick reached by the last of them."""
    found = [row(first + k, k // steps) for k in range(targets * steps)]
    return [*found, hold(first + targets * steps, targets)]


def entries(rows, begin=0, lost=()):
    found = []
    for k, (episode, step, reached, answered) in enumerate(rows, begin):
        q, stamp = np.array([0.05 * step, 0.5]), k * PERIOD
        goal = np.array([0.3 * (reached + 1), 0.5, 0.0])
        if k in lost:
            continue
        found += [
            (topics.JOINT_STATES, JointSample(stamp, NAMES, q, np.zeros(2))),
            (topics.EE_POSE, PoseSample(stamp, "world", np.array([*q, 0.0]))),
            (topics.TARGET_POSE, PoseSample(stamp, "world", goal)),
            (topics.TASK_STATUS, TaskStatus(stamp, episode, step, 0.0, reached, False, 0, False, False)),
        ]
        if answered:
            found.append((topics.JOINT_DELTA, DeltaCommand(stamp, NAMES, DELTA)))
    return found


def reviewed(path, found):
    with BagWriter(path) as bag:
        for topic, record in [*descriptions(), *found]:
            bag.write(topic, record)
    return review(Bag(path))


def reached(found):
    return [segment.reached for each in found.episodes for segment in each.segments]


def with_holds(rows, counts):
    """The rows, each followed by so many holds of its state."""
    found = []
    for each, count in zip(rows, counts, strict=True):
        found += [each, *[hold(each[1], each[2], each[0])] * count]
    return found


@settings(max_examples=30)
@given(st.lists(st.integers(0, 3), min_size=19, max_size=19), st.integers(0, 4))
def test_holds_anywhere_change_neither_targets_nor_measures(tmp_path_factory, counts, before):
    base = tmp_path_factory.mktemp("b")
    plain = reviewed(base / "plain", entries(motion()))
    held = reviewed(base / "held", entries([hold(0, 0)] * before + with_holds(motion(), counts)))
    assert reached(plain) == reached(held) == [True] * 3
    assert held.faults == []
    np.testing.assert_allclose(
        [quality[:4] for quality in held.qualities], [quality[:4] for quality in plain.qualities], atol=1e-9
    )


@pytest.mark.parametrize("place", [0, 3, 5, 6, 7, 17, 18])
def test_a_long_pause_parts_no_way(tmp_path, place):
    rows = motion()
    paused = [*rows[: place + 1], *[hold(*rows[place][1:3])] * 200, *rows[place + 1 :]]
    found = reviewed(tmp_path / "bag", entries(paused))
    assert reached(found) == [True] * 3
    assert found.faults == []


def test_a_tick_that_comes_twice_is_no_new_target(tmp_path):
    doubled = sorted(entries(motion()) * 2, key=lambda each: each[1].stamp)
    assert reached(reviewed(tmp_path / "bag", doubled)) == [True] * 3


@pytest.mark.parametrize("lost", [{3}, {5}, {6}, {7, 8}, {0, 1}, {2, 3, 4, 5, 6, 7}])
def test_lost_ticks_are_no_new_target(tmp_path, lost):
    found = reviewed(tmp_path / "bag", entries(motion(), lost=lost))
    assert reached(found) == [True] * 3


def test_an_episode_change_and_a_restart_are_new_targets(tmp_path):
    episodes = motion(targets=2)[:9] + [row(k, 0, episode=1) for k in range(4)]
    assert reached(reviewed(tmp_path / "episodes", entries(episodes))) == [True, False, False]
    restarted = entries(motion(targets=2)[:9]) + entries([row(k, 0) for k in range(4)])
    assert reached(reviewed(tmp_path / "restarted", restarted)) == [True, False, False]


def test_a_restart_before_the_first_step_is_seen_by_its_stamps(tmp_path):
    still = [row(0, 0)] * 5
    found = reviewed(tmp_path / "bag", entries(still, begin=3) + entries(motion(targets=1)))
    assert reached(found) == [False, True]


def test_ticks_lost_while_the_robot_holds_are_counted_by_the_clock(tmp_path):
    rows = motion()
    paused = [*rows[:4], *[hold(3, 0)] * 40, *rows[4:]]
    (fault,) = reviewed(tmp_path / "bag", entries(paused, lost=range(10, 30))).faults
    assert (fault.kind, fault.what) == (LOST, "20 ticks are missing: nothing for 0.42 s")
    assert (fault.first, fault.last) == (9 * PERIOD, 30 * PERIOD)


def test_a_hold_that_is_lost_within_a_step_is_no_jump_of_the_clock(tmp_path):
    rows = [*motion()[:4], hold(3, 0), hold(3, 0), hold(3, 0), *motion()[4:]]
    (fault,) = reviewed(tmp_path / "bag", entries(rows, lost={5, 6})).faults
    assert (fault.kind, fault.what) == (LOST, "2 ticks are missing: nothing for 0.06 s")


def test_a_way_with_a_part_taken_out_is_one_way_still(tmp_path):
    reviewed(tmp_path / "bag", entries(motion()))
    begin, end = 7 * PERIOD * 1e-9, 9 * PERIOD * 1e-9
    kept = [each for each in entries(motion()) if not 7 * PERIOD <= each[1].stamp < 9 * PERIOD]
    with BagWriter(tmp_path / "cut", metadata={"cuts": f"[[{6 * PERIOD}, {9 * PERIOD}]]"}) as bag:
        for topic, record in [*descriptions(), *kept]:
            bag.write(topic, record)
    found = review(Bag(tmp_path / "cut"))
    assert (reached(found), found.faults) == ([True] * 3, [])
    trim(Bag(tmp_path / "bag"), tmp_path / "part", begin, end + 1.0, lambda _: None)
    assert reached(review(Bag(tmp_path / "part"))) == [True] * 2
