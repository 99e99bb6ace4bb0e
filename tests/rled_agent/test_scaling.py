import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_agent.nn.scaling import scaling_of_bounds, scaling_of_points, scaling_of_samples
from rled_msgs_py.errors import RledError
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

ACTION = (np.array([-0.1, -0.2]), np.array([0.1, 0.4]))


def test_bounds_become_one():
    scaling = scaling_of_bounds((np.array([-1.0, 2.0]), np.array([1.0, 6.0])), ACTION)
    low, middle, high = scaling.normalize_observation(np.array([[-1.0, 2.0], [0.0, 4.0], [1.0, 6.0]]))
    assert (low.tolist(), middle.tolist(), high.tolist()) == ([-1, -1], [0, 0], [1, 1])
    np.testing.assert_allclose(
        scaling.normalize_action(np.array([ACTION[0], [0, 0.1], ACTION[1]])), [[-1] * 2, [0] * 2, [1] * 2], atol=1e-7
    )


@pytest.mark.parametrize(("low", "high"), [(-np.inf, np.inf), (-np.inf, 1.0), (0.0, np.inf), (3.0, 3.0)])
def test_an_unbounded_or_empty_component_is_left_as_it_is(low, high):
    scaling = scaling_of_bounds((np.array([low]), np.array([high])), ACTION)
    assert scaling.normalize_observation(np.array([7.5])).tolist() == [7.5]


@pytest.mark.parametrize("bounds", [([-np.inf], [1.0]), ([0.0], [np.inf]), ([1.0], [1.0]), ([1.0], [-1.0])])
def test_actions_without_finite_bounds_are_refused(bounds):
    with pytest.raises(RledError, match="no finite bounds"):
        scaling_of_bounds((np.zeros(1), np.ones(1)), tuple(map(np.array, bounds)))


def test_samples_become_mean_0_and_deviation_1():
    samples = np.random.default_rng(0).normal([5.0, -2.0, 3.0], [0.01, 4.0, 0.0], (1000, 3))
    normal = scaling_of_samples(samples, ACTION).normalize_observation(samples)
    np.testing.assert_allclose(normal.mean(axis=0), 0.0, atol=1e-4)
    np.testing.assert_allclose(normal[:, :2].std(axis=0), 1.0, rtol=1e-4)
    assert (normal[:, 2] == 0.0).all()


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=2))
def test_actions_come_back(action):
    scaling = scaling_of_bounds((np.zeros(1), np.ones(1)), ACTION)
    there = scaling.denormalize_action(np.array(action))
    np.testing.assert_allclose(scaling.normalize_action(there), action, atol=1e-6)
    assert (there >= ACTION[0] - 1e-12).all()
    assert (there <= ACTION[1] + 1e-12).all()


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=2))
def test_observations_come_back(observation):
    scaling = scaling_of_bounds((np.array([-1.0, 2.0]), np.array([1.0, 6.0])), ACTION)
    back = scaling.denormalize_observation(scaling.normalize_observation(np.array(observation)))
    np.testing.assert_allclose(back, observation, atol=1e-5)


def test_lengths_are_measured_in_halves_of_the_demonstrated_extent_and_angles_in_radians():
    positions = np.array([[0.4, -0.25, 0.5], [0.6, 0.25, 0.5], [0.5, 0.0, 0.6]])
    joints = np.array([[0.1] * 7, [0.2] * 7, [0.6] * 7])
    scaling = scaling_of_points(reach_task(ROBOTS["panda"]).description, positions, joints)
    observation = np.array([0.25, 0.0, -0.125] + [1.3] * 7)  # half of the extent is 0.25 m, the mean angle 0.3 rad
    np.testing.assert_allclose(scaling.normalize_observation(observation), [1.0, 0.0, -0.5] + [1.0] * 7, rtol=1e-6)
    np.testing.assert_allclose(scaling.normalize_action(np.full(7, 0.04)), np.ones(7), rtol=1e-6)


def test_positions_are_measured_from_the_demonstrated_mean():
    positions = np.array([[0.4, -0.25, 0.1], [0.6, 0.25, 0.1], [0.5, 0.0, 0.1]])
    scaling = scaling_of_points(reach_task(ROBOTS["planar"]).description, positions, np.zeros((3, 2)))
    normal = scaling.normalize_observation(np.array([0.5, 0.25, 0.75, -0.25]))
    np.testing.assert_allclose(normal, [0.0, 1.0, 1.0, -1.0], atol=1e-6)
