"""Episodes, with ticks that repeat a step as in real time, and their quality: worked out by hand."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rled_msgs_py.bags import Bag, BagError, BagWriter, review, trim
from rled_msgs_py.bags.episodes import discarded
from rled_msgs_py.bags.faults import LOST
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, TaskStatus, Text

from rled_msgs_py import topics

from .samples import NAMES, PERIOD, TASK, descriptions


def ticks(deltas, k=0, episode=0, reached=0, start=(0.0, 0.5), goal=(0.5, 0.5)):
    """A motion from ``start`` (rad); the end effector (m) is where the joint angles say. Entries, next k and q."""
    found, q = [], np.array(start)
    for delta in deltas:
        found += [*state(k, q, goal, episode, reached), (topics.JOINT_DELTA, DeltaCommand(k * PERIOD, NAMES, delta))]
        q, k = q + delta, k + 1
    return found, k, q


def state(k, q, goal, episode, reached):
    stamp = k * PERIOD
    return [
        (topics.JOINT_STATES, JointSample(stamp, NAMES, q, np.zeros(2))),
        (topics.EE_POSE, PoseSample(stamp, "world", np.array([q[0], q[1], 0.0]))),
        (topics.TARGET_POSE, PoseSample(stamp, "world", np.array([*goal, 0.0]))),
        (topics.TASK_STATUS, TaskStatus(stamp, episode, k, 0.0, reached, False, 0, False, False)),
    ]


def event(kind, number, k, **more):
    return (topics.EPISODE_EVENTS, Text(json.dumps({"event": kind, "episode": number, "stamp": k * PERIOD, **more})))


def judged(tmp_path, found):
    with BagWriter(tmp_path / "bag") as bag:
        for topic, record in [*descriptions(), *found]:
            bag.write(topic, record)
    return review(Bag(tmp_path / "bag"))


def reached_once(tmp_path, deltas):
    found, k, q = ticks(deltas)
    return judged(tmp_path, found + state(k, q, (0.9, 0.9), 0, 1))


STRAIGHT = [np.array([0.05, 0.0])] * 8


def test_a_straight_even_motion_to_its_target_scores_one(tmp_path):
    found = reached_once(tmp_path, STRAIGHT)
    (quality,) = found.qualities
    assert quality == pytest.approx((1.0, 1.0, 0.0, 0.0, 0.0, 1.0), abs=1e-9)


def test_a_motion_that_never_arrives_scores_nothing(tmp_path):
    found, k, q = ticks(STRAIGHT)
    (quality,) = judged(tmp_path, found + state(k, q, (0.5, 0.5), 0, 0)).qualities
    assert (quality.reached, quality.score) == (0.0, 0.0)


def test_a_detour_around_three_sides_of_a_square_is_three_times_as_long(tmp_path):
    up, on, down = np.array([0.0, 0.1]), np.array([0.1, 0.0]), np.array([0.0, -0.1])
    (quality,) = reached_once(tmp_path, [up] * 3 + [on] * 3 + [down] * 3).qualities
    assert quality.detour == pytest.approx(3.0)


def test_idle_time_is_the_share_of_ticks_without_motion(tmp_path):
    (quality,) = reached_once(tmp_path, STRAIGHT[:6] + [np.zeros(2)] * 2).qualities
    assert quality.idle == pytest.approx(0.25)
    assert quality.score < 0.95


def test_jerk_is_the_third_difference_over_the_cube_of_the_period(tmp_path):
    # q_0 = 0, 1, 3, 6, 10, 16 hundredths: third differences 0, 0, 1; q_1 rests
    steps = [np.array([0.01 * each, 0.0]) for each in (1, 2, 3, 4, 6)]
    (quality,) = reached_once(tmp_path, steps).qualities
    assert quality.jerk == pytest.approx(0.01 / np.sqrt(6) / 0.02**3)


def test_opposite_displacements_in_the_same_states_contradict_each_other(tmp_path):
    there, k, q = ticks([np.array([0.1, 0.0])] * 4, start=(0.0, 0.0))
    middle = state(k, q, (0.9, 0.9), 0, 1)
    back, k, q = ticks([np.array([-0.1, 0.0])] * 4, k + 1, 1, 0, start=(0.4, 0.0))
    found = judged(tmp_path, there + middle + back + state(k, q, (0.9, 0.9), 1, 1))
    # |(0.1) - (-0.1)| over the greatest distance 2 * 0.1 * sqrt(2)
    for quality in found.qualities:
        assert quality.contradiction == pytest.approx(1.0 / np.sqrt(2.0))
    assert max(quality.score for quality in found.qualities) < 0.8


def test_tremor_pauses_and_detours_lower_the_score(tmp_path):
    generator = np.random.default_rng(0)
    noisy = [delta + generator.normal(scale=0.02, size=2) for delta in STRAIGHT]
    paused = [np.zeros(2)] * 8 + STRAIGHT
    around = [np.array([0.0, 0.05])] * 8 + STRAIGHT + [np.array([0.0, -0.05])] * 8
    for number, deltas in enumerate((noisy, paused, around)):
        (quality,) = reached_once(tmp_path / str(number), deltas).qualities
        assert quality.score < 0.9


def test_without_events_each_target_is_an_episode(tmp_path):
    first, k, q = ticks(STRAIGHT)
    second, k, q = ticks(STRAIGHT, k, 0, 1, q, (0.9, 0.9))
    found = judged(tmp_path, first + second + state(k, q, (0.1, 0.1), 0, 2))
    assert [(each.number, each.first, each.last) for each in found.episodes] == [
        (0, 0, 8 * PERIOD),
        (1, 8 * PERIOD, 16 * PERIOD),
    ]
    assert [quality.reached for quality in found.qualities] == [1.0, 1.0]


def test_with_events_an_episode_is_what_they_say(tmp_path):
    first, k, q = ticks(STRAIGHT)
    second, k, q = ticks(STRAIGHT, k, 0, 1, q, (0.9, 0.9))
    told = [
        event("start", 4, 0, operator="ada"),
        event("stop", 4, 16),
        event("keep", 4, 16, outcome="fine"),
        event("start", 5, 17),
        event("stop", 5, 20),
        event("discard", 5, 21),
    ]
    more, k, q = ticks(STRAIGHT, k, 0, 2, q, (0.1, 0.1))
    found = judged(tmp_path, first + second + more + told)
    one, two = found.episodes
    assert (one.number, one.kept, one.operator, one.outcome, len(one.segments)) == (4, True, "ada", "fine", 2)
    assert (two.number, two.kept, two.first, two.last) == (5, False, 17 * PERIOD, 20 * PERIOD)
    assert found.qualities[0].reached == 1.0
    assert discarded(Bag(tmp_path / "bag")) == [(17 * PERIOD, 20 * PERIOD)]


def test_an_episode_whose_recorder_was_killed_reaches_to_the_end(tmp_path):
    found, _k, _q = ticks(STRAIGHT)
    (episode,) = judged(tmp_path, [event("start", 0, 0), *found]).episodes
    assert (episode.last, episode.kept) == (7 * PERIOD, True)


@pytest.mark.parametrize("text", ["", "{}", "[]", "null", '{"event": "begin", "episode": 0, "stamp": 0}'])
def test_an_event_that_cannot_be_read_is_refused(tmp_path, text):
    with BagWriter(tmp_path / "bag") as bag:
        for topic, record in [*descriptions(), (topics.EPISODE_EVENTS, Text(text))]:
            bag.write(topic, record)
    with pytest.raises(BagError, match=r"episode_events; accepted: JSON with event"):
        review(Bag(tmp_path / "bag"))


def test_a_score_lies_between_zero_and_one_for_any_motion(tmp_path):
    generator = np.random.default_rng(1)
    for number in range(20):
        deltas = generator.uniform(-1, 1, size=(generator.integers(1, 12), 2)) * TASK.max_delta
        for quality in reached_once(tmp_path / str(number), list(deltas)).qualities:
            assert 0.0 <= quality.score <= 1.0
            assert np.isfinite(quality).all()


# Ticks that repeat a step, as in real time, are no new target: episodes counted by hand.


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
