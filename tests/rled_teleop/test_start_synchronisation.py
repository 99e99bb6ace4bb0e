import time

import pytest
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import JOINT_DELTA, JOINT_STATES
from rled_teleop.recording import start_synchronisation
from rled_teleop.recording.start_synchronisation import EarlyMessage, StartSynchronisation


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
