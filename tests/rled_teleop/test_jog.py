"""Jogging against the planar arm's closed forms, at singular postures and at joint limits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_sim.robots import robot_named
from rled_sim.tasks import reach_task
from rled_teleop.operators.jog import LIMIT_MARGIN, Jog, damped_inverse, scaled_to


@pytest.fixture
def jog(task, chain):
    return Jog(task, chain)


@pytest.fixture(scope="module")
def panda():
    robot = robot_named("panda")
    return Jog(reach_task(robot).description, robot.chain)


def test_a_joint_turns_by_its_share_of_the_greatest_displacement(jog):
    np.testing.assert_array_equal(jog.joint(np.array([0.0, 1.0]), 1, -0.25), [0.0, -0.025])


def test_a_joint_stops_before_its_limit(jog):
    np.testing.assert_allclose(jog.joint(np.array([0.0, 2.95]), 1, 1.0), [0.0, 0.05 - LIMIT_MARGIN])
    np.testing.assert_allclose(jog.joint(np.array([0.0, 2.995]), 1, 1.0), [0.0, 0.0])


def test_a_joint_beyond_its_margin_may_come_back(jog):
    np.testing.assert_allclose(jog.joint(np.array([0.0, 2.995]), 1, -1.0), [0.0, -0.1])


def test_the_end_effector_moves_as_asked_away_from_singularities(jog, chain):
    q, step = np.array([-0.8, 1.6]), np.array([0.001, -0.002, 0.0])
    moved = chain.position(q + jog.cartesian(q, step)) - chain.position(q)
    np.testing.assert_allclose(moved, step, atol=5e-6)  # the curvature of a step of 2 mm


def test_components_that_the_task_does_not_use_are_left_out(jog):
    q = np.array([-0.8, 1.6])
    np.testing.assert_array_equal(jog.cartesian(q, np.array([0.0, 0.0, 0.01])), np.zeros(2))


def test_a_fast_motion_is_slowed_down_and_keeps_its_direction(jog, chain):
    q, step = np.array([-0.8, 1.6]), np.array([1.0, 0.0, 0.0])
    delta = jog.cartesian(q, step, 0.5)
    assert np.abs(delta).max() == pytest.approx(0.05)
    direction = chain.jacobian(q) @ delta
    np.testing.assert_allclose(direction / np.linalg.norm(direction), [1.0, 0.0, 0.0], atol=1e-9)


def test_a_stretched_arm_is_not_torn_outwards(jog):
    q = np.array([0.3, 0.02])  # nearly straight: its Jacobian has nearly rank 1
    outwards = 0.005 * np.array([np.cos(0.31), np.sin(0.31), 0.0])
    undamped = np.linalg.pinv(jog.chain.jacobian(q)[:2]) @ outwards[:2]
    assert np.abs(undamped).max() > 0.5
    assert np.abs(jog.cartesian(q, outwards)).max() < 0.02


def test_damping_goes_over_into_none():
    jacobian, step = np.diag([1.0, 0.05]), np.array([0.0, 0.01])
    np.testing.assert_allclose(damped_inverse(jacobian, step), [0.0, 0.2])
    nearer = damped_inverse(np.diag([1.0, 0.0499]), step)
    assert nearer[1] == pytest.approx(0.2, rel=0.05)
    np.testing.assert_array_equal(damped_inverse(np.diag([1.0, 0.0]), step), [0.0, 0.0])


@given(
    place=st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7),
    step=st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
    share=st.floats(0.01, 1.0),
)
def test_a_jog_is_always_one_that_the_simulation_takes(panda, place, step, share):
    low, high = np.array(panda.task.joint_lower), np.array(panda.task.joint_upper)
    q = low + np.array(place) * (high - low)
    delta = panda.cartesian(q, np.array(step), share)
    assert np.isfinite(delta).all()
    assert np.abs(delta).max() <= share * panda.task.max_delta * (1 + 1e-12)
    assert ((q + delta >= low - 1e-12) & (q + delta <= high + 1e-12)).all()


def test_the_other_joints_make_up_for_one_at_its_limit(panda):
    q = np.array(robot_named("panda").home)
    q[3] = panda.task.joint_upper[3] - LIMIT_MARGIN  # the elbow cannot open further
    step = np.array([0.002, 0.0, 0.0])
    delta = panda.cartesian(q, step)
    moved = panda.chain.position(q + delta) - panda.chain.position(q)
    assert delta[3] <= 0.0
    np.testing.assert_allclose(moved, step, atol=5e-4)


def test_scaling_leaves_small_displacements_alone():
    np.testing.assert_array_equal(scaled_to(np.array([0.01, -0.02]), 0.04), [0.01, -0.02])
    np.testing.assert_allclose(scaled_to(np.array([0.01, -0.08]), 0.04), [0.005, -0.04])
