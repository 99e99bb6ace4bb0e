"""What a demonstrator does, and what hand goes wrong in it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rled_msgs_py.task import TaskDescription
from rled_teleop.operators.demonstration import demonstrated_action
from rled_teleop.operators.imperfection import Hand, Imperfection

JOINTS = arrays(np.float64, 7, elements=st.floats(-3.0, 3.0))
DELTAS = st.floats(1e-3, 0.5)


def motion(q: np.ndarray, goal: np.ndarray, max_delta: float) -> np.ndarray:
    path = [q]
    while np.abs(goal - path[-1]).max() > 1e-9:
        path.append(path[-1] + demonstrated_action(path[-1], goal, max_delta))
        assert len(path) < 10_000
    return np.array(path)


def test_far_from_the_goal_the_farthest_joint_moves_by_max_delta() -> None:
    # e = (0.8, -0.4, 0.2), e_qmax = 0.8: 0.04 / 0.8 = 1/20 of each
    action = demonstrated_action(np.array([0.0, 0.4, 1.0]), np.array([0.8, 0.0, 1.2]), 0.04)
    np.testing.assert_allclose(action, [0.04, -0.02, 0.01], rtol=1e-12)


def test_within_max_delta_the_goal_is_met_in_one_step() -> None:
    action = demonstrated_action(np.array([0.0, 0.0]), np.array([-0.03, 0.01]), 0.04)
    np.testing.assert_array_equal(action, [-0.03, 0.01])


def test_at_the_goal_the_action_is_zero() -> None:
    np.testing.assert_array_equal(demonstrated_action(np.ones(7), np.ones(7), 0.04), np.zeros(7))


def test_a_batch_is_answered_row_by_row() -> None:
    q, goal = np.random.default_rng(0).normal(size=(2, 5, 7))
    rows = [demonstrated_action(*pair, 0.04) for pair in zip(q, goal, strict=True)]
    np.testing.assert_array_equal(demonstrated_action(q, goal, 0.04), rows)


@given(JOINTS, JOINTS, DELTAS)
def test_no_component_exceeds_max_delta(q: np.ndarray, goal: np.ndarray, max_delta: float) -> None:
    assert np.abs(demonstrated_action(q, goal, max_delta)).max() <= max_delta


@given(JOINTS, JOINTS, DELTAS)
def test_the_motion_is_a_straight_line_in_joint_space(q: np.ndarray, goal: np.ndarray, max_delta: float) -> None:
    path = motion(q, goal, max_delta)
    offset = goal - q
    if np.abs(offset).max() < 1e-6:
        return
    along = (path - q) @ offset / (offset @ offset)  # share of the way, (k,)
    assert (np.diff(along) > 0).all()
    np.testing.assert_allclose(path, q + along[:, None] * offset, atol=1e-9)


@given(JOINTS, JOINTS, DELTAS)
def test_the_goal_is_reached_in_the_fewest_steps(q: np.ndarray, goal: np.ndarray, max_delta: float) -> None:
    exact = np.abs(goal - q).max() / max_delta
    steps = len(motion(q, goal, max_delta)) - 1
    assert steps == np.ceil(exact) or abs(exact - round(exact)) < 1e-6
    assert steps == pytest.approx(exact, abs=1.0)


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
