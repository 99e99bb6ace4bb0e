import math

import numpy as np
import pytest
from rled_agent.uncertainty.measures import iqr, qcd, quartiles


def test_quartiles_of_five_values_are_the_second_and_the_fourth():
    low, high, _ = quartiles(np.array([[5.0, -1.0], [1.0, -2.0], [4.0, -3.0], [2.0, -4.0], [3.0, -5.0]]))
    assert low == [2.0, -4.0]
    assert high == [4.0, -2.0]


def test_quartiles_between_values_are_interpolated():
    low, high, _ = quartiles(np.array([[1.0], [2.0], [3.0], [10.0]]))
    assert (low[0], high[0]) == (1.75, 4.75)  # places 0.75 and 2.25


@pytest.mark.parametrize("passes", [2, 3, 4, 7, 30, 101])
def test_quartiles_equal_numpys(passes):
    actions = np.random.default_rng(passes).normal(size=(passes, 7))
    low, high, mean = quartiles(actions)
    np.testing.assert_allclose([low, high], np.percentile(actions, [25, 75], axis=0), rtol=1e-12)
    np.testing.assert_allclose(mean, actions.mean(axis=0), rtol=1e-12)


def test_qcd_is_the_mean_over_the_components():
    # |4 - 2| / |4 + 2| = 1/3 and |-2 + 4| / |-2 - 4| = 1/3; |1 - 0| / |1 + 0| = 1
    assert qcd(np.array([2.0, -4.0]), np.array([4.0, -2.0])) == pytest.approx(1 / 3)
    assert qcd(np.array([2.0, -4.0, 0.0]), np.array([4.0, -2.0, 1.0])) == pytest.approx(5 / 9)


def test_qcd_of_two_quartiles_at_zero_is_no_dispersion():
    assert qcd(np.zeros(2), np.zeros(2)) == 0.0
    assert qcd(np.array([0.0, 2.0]), np.array([0.0, 4.0])) == pytest.approx(1 / 6)


@pytest.mark.filterwarnings("error")
def test_qcd_has_no_bound_around_zero():
    assert qcd(np.array([-1.0]), np.array([1.0])) == math.inf
    assert qcd(np.array([-0.99]), np.array([1.0])) == pytest.approx(199.0)


def test_iqr_is_a_share_of_the_action_range():
    assert iqr(np.array([-1.0, -1.0]), np.array([1.0, 1.0])) == 1.0
    assert iqr(np.array([0.1, 0.3]), np.array([0.2, 0.6])) == pytest.approx((0.1 + 0.3) / 2 / 2)
    assert iqr(np.array([0.3]), np.array([0.3])) == 0.0
