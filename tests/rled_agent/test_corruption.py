"""Demonstrations that are made worse on purpose."""

from dataclasses import replace

import numpy as np
import pytest
from rled_agent.data.corruption import Corruption
from rled_msgs_py.errors import ContractError


def draw(zeta, corruption: Corruption, size: int = 4000):
    return replace(zeta, corruption=corruption).draw(size, np.random.default_rng(5))


def test_a_trembling_hand_goes_wrong_in_nothing_but_its_displacements(zeta):
    good, shaken = draw(zeta, Corruption()), draw(zeta, Corruption(tremor=0.1))
    for name in ("q", "position", "target"):
        np.testing.assert_array_equal(getattr(shaken, name), getattr(good, name))
    most = zeta.task.max_delta
    assert np.abs(shaken.action).max() <= most
    inside = np.abs(good.action) < 0.5 * most  # five deviations from where it would be cut off
    noise = (shaken.action - good.action)[inside]
    assert noise.std() == pytest.approx(0.1 * most, rel=0.1)
    assert abs(noise.mean()) < 4 * 0.1 * most / np.sqrt(noise.size)


def test_what_was_shown_for_a_share_of_the_motions_is_another_target(zeta):
    points = len(zeta.points.joints)
    goals = Corruption(wrong=0.3).goals_shown(points).reshape(points, points)
    wrong = (goals != np.arange(points)).mean()
    assert abs(wrong - 0.3) < 4 * np.sqrt(0.3 * 0.7 / points**2)
    assert (Corruption(wrong=1.0).goals_shown(points).reshape(points, points) != np.arange(points)).all()
    assert (Corruption().goals_shown(points).reshape(points, points) == np.arange(points)).all()
    assert (Corruption(wrong=0.3, seed=1).goals_shown(points) != goals.ravel()).any()


def test_a_wrong_motion_is_a_good_one_to_another_point(zeta):
    good, wrong = draw(zeta, Corruption()), draw(zeta, Corruption(wrong=0.5))
    for name in ("q", "position", "action"):
        np.testing.assert_array_equal(getattr(wrong, name), getattr(good, name))
    differs = (wrong.target != good.target).any(axis=1)
    assert 0.4 < differs.mean() < 0.6
    shown = {tuple(target) for target in wrong.target[differs]}
    assert shown <= {tuple(point) for point in zeta.points.positions}


def test_parts_of_poor_demonstrations_are_as_poor(zeta):
    parts = replace(zeta, corruption=Corruption(tremor=0.2, wrong=0.1)).split(0.2, np.random.default_rng(0))
    assert [part.corruption for part in parts] == 2 * [Corruption(tremor=0.2, wrong=0.1)]


@pytest.mark.parametrize("given", [{"tremor": -0.1}, {"wrong": 1.1}, {"seed": -1}])
def test_flaws_that_cannot_be_are_refused(given):
    with pytest.raises(ContractError, match=f"{next(iter(given))} is .*; accepted: 0 to"):
        Corruption(**given)
