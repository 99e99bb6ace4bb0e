import numpy as np
import pytest
from rled_msgs_py.task import TaskDescription
from rled_teleop.operators.imperfection import Hand, Imperfection

INTENDED = np.array([0.05, -0.02])


def moves(imperfection: Imperfection, task: TaskDescription, seed: int = 0, count: int = 2000) -> np.ndarray:
    hand = Hand(imperfection, task, np.random.default_rng(seed))
    return np.array([hand.move(INTENDED) for _ in range(count)])


def test_a_perfect_hand_moves_as_intended_and_draws_nothing(task: TaskDescription) -> None:
    generator = np.random.default_rng(0)
    hand = Hand(Imperfection(), task, generator)
    np.testing.assert_array_equal(hand.move(INTENDED), INTENDED)
    np.testing.assert_array_equal(hand.waypoints(np.zeros(2), INTENDED), [INTENDED])
    assert generator.random() == np.random.default_rng(0).random()
    assert hand.arrived_within(1e-6) == 1e-6


def test_tremor_has_the_deviation_asked_for(task: TaskDescription) -> None:
    noise = moves(Imperfection(tremor=0.1), task) - INTENDED
    assert noise.std() == pytest.approx(0.1 * task.max_delta, rel=0.05)
    assert noise.mean() == pytest.approx(0.0, abs=1e-3)


def test_tremor_never_exceeds_max_delta(task: TaskDescription) -> None:
    assert np.abs(moves(Imperfection(tremor=5.0), task)).max() == task.max_delta


def test_pauses_have_the_chance_and_the_mean_length_asked_for(task: TaskDescription) -> None:
    still = (moves(Imperfection(pause_probability=0.05, pause_steps=8.0), task, count=20_000) == 0).all(axis=1)
    begins = np.flatnonzero(np.diff(still.astype(int)) == 1)
    lengths = still.sum() / len(begins)
    assert lengths == pytest.approx(8.0, rel=0.1)
    assert len(begins) / (~still).sum() == pytest.approx(0.05, rel=0.1)


def test_overshoot_steers_past_the_goal_and_back(task: TaskDescription) -> None:
    hand = Hand(Imperfection(overshoot=0.2), task, np.random.default_rng(0))
    beyond, goal = hand.waypoints(np.array([1.0, 1.0]), np.array([2.0, 0.5]))
    np.testing.assert_allclose(beyond, [2.2, 0.4])
    np.testing.assert_array_equal(goal, [2.0, 0.5])


def test_overshoot_stays_within_the_joint_limits(task: TaskDescription) -> None:
    hand = Hand(Imperfection(overshoot=0.5), task, np.random.default_rng(0))
    beyond, _ = hand.waypoints(np.array([0.0, 1.0]), np.array([3.0, 0.1]))
    np.testing.assert_allclose(beyond, [3.14, 0.0])


def test_the_same_seed_gives_the_same_hand(task: TaskDescription) -> None:
    for imperfection in [Imperfection(tremor=0.3), Imperfection(pause_probability=0.2), Imperfection(overshoot=0.1)]:
        np.testing.assert_array_equal(moves(imperfection, task, seed=3), moves(imperfection, task, seed=3))


def test_another_seed_gives_another_tremor(task: TaskDescription) -> None:
    assert (moves(Imperfection(tremor=0.1), task, 1) != moves(Imperfection(tremor=0.1), task, 2)).all()
