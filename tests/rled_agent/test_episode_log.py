import numpy as np
from rled_agent.nodes.episode_log import EpisodeLog
from rled_agent.nodes.watch_episodes import summarize
from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.tick import Tick

TARGETS = (np.array([1.0, 0, 0]), np.array([2.0, 0, 0]))


def tick(episode, step, reward=-1.0, reached=0, end="", target=0, violations=0) -> Tick:
    stamp = (100 * episode + step) * 20_000_000
    return Tick(
        JointSample(stamp, ("a",), np.zeros(1), np.zeros(1)),
        PoseSample(stamp, "world", np.array([episode, step, 0.0])),
        PoseSample(stamp, "world", TARGETS[target]),
        TaskStatus(stamp, episode, step, reward, reached, False, violations, end == "done", end == "cut"),
    )


def test_a_whole_episode_is_added_up():
    log = EpisodeLog(1)
    for each in (
        tick(3, 0, reward=0.0),
        tick(3, 1, reward=5.0, reached=1, target=1),
        tick(3, 2, violations=2, reached=1, target=1),
        tick(3, 3, reward=4.0, reached=2, end="done", target=1, violations=2),
    ):
        assert not log.full
        log.add(each)
    assert log.full
    (episode,) = log.finished
    assert (episode.number, episode.steps, episode.targets_reached, episode.violations) == (3, 3, 2, 2)
    assert episode.reward == 8.0
    np.testing.assert_array_equal(episode.path, [[3, 0, 0], [3, 1, 0], [3, 2, 0], [3, 3, 0]])
    np.testing.assert_array_equal(episode.targets, TARGETS)


def test_an_episode_whose_begin_was_missed_does_not_count():
    log = EpisodeLog(2)
    for each in (tick(0, 7), tick(0, 8, end="cut"), tick(1, 0), tick(1, 1, end="cut"), tick(2, 0)):
        log.add(each)
    assert [each.number for each in log.finished] == [1]


def test_an_episode_that_was_cut_off_by_a_reset_does_not_count():
    log = EpisodeLog(2)
    for each in (tick(0, 0), tick(0, 1), tick(1, 0), tick(1, 1, end="cut")):
        log.add(each)
    assert [each.number for each in log.finished] == [1]


def test_a_full_log_takes_no_more():
    log = EpisodeLog(1)
    for episode in range(3):
        log.add(tick(episode, 0))
        log.add(tick(episode, 1, end="done"))
    assert len(log.finished) == 1


def test_the_summary_holds_means_and_each_episode():
    log = EpisodeLog(2)
    for each in (
        tick(0, 0, reward=0.0),
        tick(0, 1, reward=2.0, reached=1, end="done"),
        tick(1, 0, reward=0.0),
        tick(1, 1, reward=-3.0),
        tick(1, 2, reward=-3.0, violations=1, end="cut"),
    ):
        log.add(each)
    summary = summarize(log.finished)
    assert summary["each"] == [
        {"targets_reached": 1, "steps": 1, "reward": 2.0, "violations": 0},
        {"targets_reached": 0, "steps": 2, "reward": -6.0, "violations": 1},
    ]
    assert {name: summary[name] for name in ("episodes", "targets_reached", "steps", "reward", "violations")} == {
        "episodes": 2,
        "targets_reached": 0.5,
        "steps": 1.5,
        "reward": -2.0,
        "violations": 0.5,
    }
