import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rled_teleop.operators.demonstration import demonstrated_action

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
