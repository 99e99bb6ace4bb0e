from dataclasses import replace

import numpy as np
import pytest
from rled_agent.data.demonstrations import DemonstrationPoints, JoinedPoints
from rled_agent.data.expert_rows import ExpertRows
from rled_agent.nn.scaling import Scaling
from rled_msgs_py.errors import RledError
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

AS_IT_IS = Scaling(np.zeros(4), np.ones(4), np.zeros(2), np.ones(2))


def rows_of(zeta: JoinedPoints, size: int, seed: int = 0, **changes: object) -> np.ndarray:
    zeta = replace(zeta, task=replace(zeta.task, **changes))
    return ExpertRows(zeta, AS_IT_IS).sample(size, np.random.default_rng(seed)).numpy()


@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_rows_are_the_transitions_of_the_task(three_points, reward):
    robot = ROBOTS["planar"]
    task = reach_task(robot, reward=reward)
    rows = rows_of(three_points, 400, reward=reward)
    moves = three_points.at(np.arange(len(three_points)))
    states = np.hstack([moves.position[:, :2], moves.target[:, :2]])
    seen = set()
    for row in rows:
        k = int(np.abs(states - row[:4]).sum(axis=1).argmin())  # which of the 22 transitions
        seen.add(k)
        q = moves.q[k] + moves.action[k]
        tip = tuple(robot.chain.position(q))
        squared = sum((a - b) ** 2 for a, b in zip(tip, moves.target[k], strict=True))
        reached = squared < 1e-3
        assert sum((moves.position[k] - moves.target[k]) ** 2) >= 1e-3
        np.testing.assert_allclose(row[:4], states[k], atol=1e-6)
        np.testing.assert_allclose(row[4:6], moves.action[k], atol=1e-6)
        assert row[6] == pytest.approx(task.reward(squared, reached, task.risky(q, tip)), abs=1e-5)
        assert row[7] == reached  # one target ends the episode
        np.testing.assert_allclose(row[8:10], tip[:2], atol=1e-6)
        if not reached:
            np.testing.assert_allclose(row[10:12], moves.target[k][:2], atol=1e-6)
    assert len(seen) > 10
    assert 0 < rows[:, 7].sum() < 400


def test_a_reached_target_is_followed_by_any_of_the_points(three_points):
    rows = rows_of(three_points, 3000)
    ended = rows[rows[:, 7] == 1]
    following, changed = ended[:, 10:12], (ended[:, 10:12] != ended[:, 2:4]).any(axis=1)
    assert changed.mean() == pytest.approx(2 / 3, abs=4 * (2 / 9 / len(ended)) ** 0.5)
    points, counts = np.unique(following.round(5), axis=0, return_counts=True)
    np.testing.assert_allclose(points, np.unique(three_points.points.positions[:, :2].round(5), axis=0), atol=1e-5)
    assert np.square(counts - counts.mean()).sum() / counts.mean() < 13.8  # chi-square, 2 degrees: once in 1000


@pytest.mark.parametrize(("targets", "share"), [(0, 0.0), (1, 1.0), (4, 0.25)])
def test_a_reached_target_is_the_last_one_as_often_as_it_is_in_an_episode(three_points, targets, share):
    rows = rows_of(three_points, 5000, reward="sparse", targets_per_episode=targets)
    reached = rows[:, 6] > 0
    assert not rows[~reached, 7].any()
    count = reached.sum()
    assert abs(rows[reached, 7].mean() - share) <= 4 * np.sqrt(share * (1 - share) / count)


def test_rows_are_in_the_units_of_the_scaling(three_points):
    doubled = Scaling(np.ones(4), np.full(4, 2.0), np.zeros(2), np.full(2, 0.1))
    plain = rows_of(three_points, 50)
    scaled = ExpertRows(three_points, doubled).sample(50, np.random.default_rng(0)).numpy()
    np.testing.assert_allclose(scaled[:, :4], (plain[:, :4] - 1) / 2, atol=1e-6)
    np.testing.assert_allclose(scaled[:, 4:6], plain[:, 4:6] / 0.1, atol=1e-6)
    np.testing.assert_array_equal(scaled[:, 6:8], plain[:, 6:8])
    np.testing.assert_allclose(scaled[:, 8:], (plain[:, 8:] - 1) / 2, atol=1e-6)


def test_same_seed_draws_the_same_rows(three_points):
    np.testing.assert_array_equal(rows_of(three_points, 50, seed=1), rows_of(three_points, 50, seed=1))
    assert not np.array_equal(rows_of(three_points, 50, seed=1), rows_of(three_points, 50, seed=2))


def test_points_within_one_targets_tolerance_are_refused(task):
    joints = np.array([[-0.5, 1.0], [-0.5, 1.01]])
    chain = ROBOTS["planar"].chain
    zeta = JoinedPoints(task, DemonstrationPoints(chain.position(joints), joints), chain)
    with pytest.raises(RledError, match="marked points"):
        ExpertRows(zeta, AS_IT_IS)
