"""Episodes of a recording: what their events say, and what is refused."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from rled_msgs_py.messages import encode
from rled_msgs_py.records import TaskStatus
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.topics import TASK_STATUS
from rled_teleop.recording.episode_events import REACHED, EpisodeEvents, Provenance, Refusal, count_of


@pytest.fixture
def episodes(task):
    counted = EpisodeEvents(Provenance("ada", "0.1.0"))
    counted.describe(task)
    return counted


def status(reached: int) -> TaskStatus:
    return TaskStatus(7, 0, 3, -0.5, reached, False, 0, False, False)


@given(st.integers(0, 10**9))
def test_targets_reached_are_read_from_bytes_of_both_serializers(count):
    assert count_of(REACHED, encode(TASK_STATUS, status(count))) == count
    assert count_of(REACHED, serialize_message(to_msg(status(count)))) == count


@given(st.binary(max_size=60), st.integers(0, 400))
def test_broken_bytes_say_nothing(noise, cut):
    assert count_of(REACHED, noise) is None
    whole = encode(TASK_STATUS, status(5))
    assert count_of(REACHED, whole[:cut]) in (None, 5)


def test_an_event_says_who_demonstrates_what(episodes):
    assert json.loads(episodes.start(20)) == {
        "event": "start",
        "episode": 0,
        "stamp": 20,
        "operator": "ada",
        "robot": "arm",
        "task": "reach",
        "max_delta": 0.1,
        "outcome": "",
        "version": "0.1.0",
    }


def test_the_outcome_is_of_the_episode_alone(episodes):
    outcomes = []
    for counts in ((0, 0, 1, 1), (1, 1, 1), (2,), (0, 0), (0, 1)):  # the fourth and fifth follow a reset
        episodes.start(0)
        for count in counts:
            episodes.observe(count)
        outcomes.append(json.loads(episodes.stop(9))["outcome"])
    assert outcomes == ["reached", "not reached", "reached", "not reached", "reached"]


def test_episodes_are_numbered_and_judged(episodes):
    episodes.start(0)
    assert [json.loads(event)["event"] for event in episodes.judge("discard", 5)] == ["stop", "discard"]
    assert json.loads(episodes.start(6))["episode"] == 1
    episodes.stop(7)
    assert [json.loads(event)["event"] for event in episodes.judge("keep", 8)] == ["keep"]


def test_what_does_not_fit_is_refused(episodes):
    for ask in (lambda: episodes.stop(0), lambda: episodes.judge("keep", 0)):
        with pytest.raises(Refusal):
            ask()
    episodes.start(0)
    with pytest.raises(Refusal, match="episode 0 is being recorded"):
        episodes.start(1)


def test_a_task_that_begins_with_targets_reached_before_is_not_reached(episodes):
    episodes.observe(4)
    episodes.start(0)
    episodes.observe(4)
    assert json.loads(episodes.stop(1))["outcome"] == "not reached"
    assert np.isfinite(json.loads(episodes.start(2))["max_delta"])
