"""Draws made of uniforms: their distribution, and how many uniforms they take."""

import math

import numpy as np
import pytest
import torch
from rled_sim.draws import index, normal_draws, normals, offset
from rled_sim.fault_channel import FaultChannel, fault_draws
from rled_sim.faults import Faults
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task
from rled_sim.vector.arrays import Arrays
from rled_sim.vector.draws import AHEAD, Draws

PLANAR = ROBOTS["planar"]


class Largest:
    """A generator of the largest number below 1."""

    def random(self):
        return 1.0 - 2.0**-53


@pytest.mark.parametrize("count", [1, 2, 3, 400, 1572, 10**9 + 7])
def test_an_index_is_within_its_range(count):
    assert index(Largest(), count) == count - 1


def test_offsets_by_hand():
    assert [offset(each, 0.5) for each in (0.0, 0.25, 0.5, 0.75)] == [-0.5, -0.25, 0.0, 0.25]


def test_normal_numbers_by_hand():
    # radius of u = 1 - e^-2: sqrt(4) = 2; a sixth of a turn: cosine 1/2, sine sqrt(3)/2
    found = normals(np.array([1.0 - math.exp(-2.0), 1.0 / 6.0]), 2)
    np.testing.assert_allclose(found, (1.0, math.sqrt(3.0)), rtol=1e-14)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_normal_numbers_have_the_moments_of_a_normal_distribution(count):
    uniforms = np.random.default_rng(0).random((100_000, normal_draws(count)))
    found = normals(uniforms, count)
    assert found.shape == (100_000, count)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.015)
    np.testing.assert_allclose(np.cov(found.T), np.eye(count) if count > 1 else 1.0, atol=0.02)
    np.testing.assert_allclose((found**4).mean(axis=0), 3.0, atol=0.2)
    np.testing.assert_allclose(normals(torch.from_numpy(uniforms), count).numpy(), found, atol=1e-12)


def words(rng, before):
    """How many 64-bit words a generator has given since its state ``before``."""
    other = np.random.PCG64()
    other.state = before
    for count in range(1000):
        if other.state["state"] == rng.bit_generator.state["state"]:
            return count
        other.advance(1)
    raise AssertionError


def test_each_call_of_a_faulty_channel_takes_as_many_words_whatever_happens():
    made = FaultChannel(Faults(command_loss=0.5, control_delay_spread=3), reach_task(PLANAR).description, None)
    made.seed(0)
    for delta in ([0.0, 0.0], None, [0.1, 0.1], [0.1, 0.0], None):
        before = made._rng.bit_generator.state
        made.act(delta)
        assert words(made._rng, before) == fault_draws(2) == 5


@pytest.mark.parametrize(("spread", "count"), [(0.0, 1), (0.1, 3)])
def test_a_target_takes_one_word_and_one_for_each_spread_axis(spread, count):
    task, rng = reach_task(PLANAR, target_spread=spread), np.random.default_rng(0)
    before = rng.bit_generator.state
    task.draw_target(rng)
    assert words(rng, before) == task.target_draws == count


@pytest.mark.parametrize("device", [None, "cpu"])
def test_a_pool_gives_each_row_the_numbers_of_its_generator_in_their_order(device):
    arrays, seeds = Arrays(device), [5, 0, 7]
    draws, rng = Draws(arrays, 3, 4), np.random.default_rng(1)
    draws.seed(seeds)
    taken = [[] for _ in seeds]
    for _ in range(AHEAD):
        draws.reserve()
        for count in (1, 3):
            which = rng.random(3) < (0.1, 0.5, 1.0)
            uniforms = draws.take(arrays.array(which, "bool"), count)
            for row in np.flatnonzero(which):
                taken[row] += uniforms[row].tolist()
    for seed, numbers in zip(seeds, taken, strict=True):
        assert numbers == np.random.default_rng(seed).random(len(numbers)).tolist()
    assert draws.state()["taken"].tolist() == [len(numbers) for numbers in taken]
