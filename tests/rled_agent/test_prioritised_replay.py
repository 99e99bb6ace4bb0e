"""Prioritised replay against probabilities, weights and sums worked out by hand."""

import numpy as np
import pytest
import torch
from rled_agent.replay.prioritised import PrioritisedReplay
from rled_agent.replay.transitions import Step
from rled_agent.replay.uniform import UniformReplay


def make(capacity: int = 4, seed: int = 0, alpha: float = 1.0, beta: float = 1.0, epsilon: float = 0.0):
    return PrioritisedReplay(UniformReplay(1, 1, capacity, torch.Generator().manual_seed(seed)), alpha, beta, epsilon)


def fill(replay: PrioritisedReplay, count: int) -> PrioritisedReplay:
    for k in range(count):
        replay.add(Step(np.array([k], np.float32), np.zeros(1, np.float32), 0.0, 1.0, np.zeros(1, np.float32)))
    return replay


def set_errors(replay: PrioritisedReplay, *errors: float) -> None:
    replay.update_priorities(torch.arange(len(errors)), torch.tensor(errors))


def shares(replay: PrioritisedReplay, size: int = 40_000) -> np.ndarray:
    return np.bincount(replay.sample(size).indices.numpy(), minlength=len(replay)) / size


def test_transitions_are_drawn_in_proportion_to_their_priorities():
    replay = fill(make(), 4)
    set_errors(replay, 4.0, -1.0, 2.0, 1.0)  # the sign does not count
    np.testing.assert_allclose(shares(replay), [4 / 8, 1 / 8, 2 / 8, 1 / 8], atol=2 / 40_000)  # in equal parts


def test_alpha_and_epsilon_shape_the_priorities():
    replay = fill(make(alpha=0.5, epsilon=1.0), 4)
    set_errors(replay, 3.0, 0.0, 8.0, 15.0)  # with epsilon 4, 1, 9 and 16, whose roots are 2, 1, 3 and 4
    np.testing.assert_allclose(shares(replay), [0.2, 0.1, 0.3, 0.4], atol=2 / 40_000)
    replay = fill(make(alpha=0.0), 4)
    set_errors(replay, 100.0, 1.0, 1.0, 1.0)
    np.testing.assert_allclose(shares(replay), [0.25] * 4, atol=2 / 40_000)


def test_draws_are_independent_of_each_other_within_their_parts():
    """Two draws of a batch of two: the first half of the sum holds transition 0, the second the other two."""
    replay = fill(make(), 3)
    set_errors(replay, 2.0, 1.0, 1.0)
    drawn = torch.stack([replay.sample(2).indices for _ in range(2000)])
    assert (drawn[:, 0] == 0).all()
    seconds = drawn[:, 1].bincount(minlength=3)[1:]
    assert np.square(seconds.numpy() - 1000).sum() / 1000 < 10.8  # chi-square, 1 degree of freedom: once in 1000


@pytest.mark.parametrize("beta", [0.0, 0.5, 1.0])
def test_weights_correct_for_the_chance_to_be_drawn(beta):
    replay = fill(make(beta=beta), 4)
    set_errors(replay, 4.0, 1.0, 2.0, 1.0)  # 4 P is 2, 1/2, 1 and 1/2; over the greatest of them: 1/4, 1, 1/2 and 1
    batch = replay.sample(64)
    expected = np.array([1 / 4, 1.0, 1 / 2, 1.0])[batch.indices.numpy()] ** beta
    np.testing.assert_allclose(batch.weight[:, 0].numpy(), expected, rtol=1e-6)
    assert (batch.observation[:, 0] == batch.indices).all()


def test_a_new_transition_has_the_greatest_priority_there_was():
    replay = fill(make(capacity=8), 2)
    np.testing.assert_allclose(shares(replay), [0.5, 0.5], atol=1e-4)
    set_errors(replay, 6.0, 2.0)
    set_errors(replay, 3.0, 2.0)  # the greatest is remembered
    fill(replay, 1)
    np.testing.assert_allclose(shares(replay), [3 / 11, 2 / 11, 6 / 11], atol=1e-4)
    replay.extend(replay.sample(1))
    np.testing.assert_allclose(shares(replay), [3 / 17, 2 / 17, 6 / 17, 6 / 17], atol=1e-4)


def test_a_transition_that_replaces_another_takes_none_of_its_priority():
    replay = fill(make(capacity=3), 3)
    set_errors(replay, 0.25, 0.25, 0.5)
    fill(replay, 1)
    np.testing.assert_allclose(shares(replay), [1 / 1.75, 0.25 / 1.75, 0.5 / 1.75], atol=1e-4)


@pytest.mark.parametrize("capacity", [1, 2, 3, 5, 8, 13])
def test_every_node_of_the_tree_is_the_sum_of_its_leaves(capacity):
    replay, drawing = fill(make(capacity), 2 * capacity + 1), np.random.default_rng(capacity)
    for _ in range(20):
        indices = drawing.integers(capacity, size=4)
        replay.update_priorities(torch.from_numpy(indices), torch.from_numpy(drawing.exponential(size=4)))
        fill(replay, int(drawing.integers(3)))
    sums, leaves = replay._sums, replay._leaves
    assert leaves >= capacity
    for node in range(1, leaves):
        assert sums[node] == pytest.approx(sums[2 * node] + sums[2 * node + 1])
    assert (sums[leaves : leaves + capacity] > 0.0).all()
    assert not sums[leaves + capacity :].any()


def test_no_place_that_is_empty_is_drawn():
    replay = fill(make(capacity=1000), 7)
    assert set(replay.sample(5000).indices.tolist()) == set(range(7))


def test_of_two_errors_for_one_transition_the_last_counts():
    replay = fill(make(), 2)
    replay.update_priorities(torch.tensor([0, 1, 0]), torch.tensor([9.0, 1.0, 3.0]))
    np.testing.assert_allclose(shares(replay), [3 / 4, 1 / 4], atol=1e-4)


@pytest.mark.parametrize("count", [2, 4, 6])
def test_it_goes_on_from_its_state(count):
    one, other = fill(make(alpha=0.6, epsilon=1e-3), count), fill(make(alpha=0.6, epsilon=1e-3), 3)
    set_errors(one, 5.0, 0.5)
    state = one.state_dict()
    other.load_state_dict({name: each.clone() if torch.is_tensor(each) else each for name, each in state.items()})
    for replay in (one, other):
        fill(replay, 1)
        replay._replay.generator.manual_seed(3)
    left, right = (replay.sample(50) for replay in (one, other))
    assert all(torch.equal(a, b) for a, b in zip(left, right, strict=True))
