"""Prioritised replay against probabilities, weights and sums worked out by hand."""

import numpy as np
import pytest
import torch
from rled_agent.nn.draws import Draws
from rled_agent.replay.prioritised import PrioritisedReplay
from rled_agent.replay.transitions import Step
from rled_agent.replay.uniform import UniformReplay
from rled_msgs_py.errors import RledError


def prioritised(
    capacity: int = 4, seeds: tuple[int, ...] = (0,), alpha: float = 1.0, beta: float = 1.0, epsilon: float = 0.0
) -> PrioritisedReplay:
    return PrioritisedReplay(UniformReplay(1, 1, capacity, Draws(seeds)), alpha, beta, epsilon)


def with_states(replay: PrioritisedReplay, count: int) -> PrioritisedReplay:
    seeds = len(replay._sums)
    for k in range(count):
        zero = torch.zeros(seeds, 1)
        columns = torch.zeros(seeds), torch.ones(seeds), zero, torch.zeros(seeds), torch.zeros(seeds, dtype=torch.bool)
        replay.add(Step(torch.full((seeds, 1), float(k)), zero, *columns))
    return replay


def set_errors(replay: PrioritisedReplay, *errors: float) -> None:
    replay.update_priorities(torch.arange(len(errors))[None], torch.tensor([errors]))


def shares(replay: PrioritisedReplay, size: int = 40_000) -> np.ndarray:
    return np.bincount(replay.sample(size).indices[0].numpy(), minlength=len(replay)) / size


def test_transitions_are_drawn_in_proportion_to_their_priorities():
    replay = with_states(prioritised(), 4)
    set_errors(replay, 4.0, -1.0, 2.0, 1.0)  # the sign does not count
    np.testing.assert_allclose(shares(replay), [4 / 8, 1 / 8, 2 / 8, 1 / 8], atol=2 / 40_000)  # in equal parts


def test_alpha_and_epsilon_shape_the_priorities():
    replay = with_states(prioritised(alpha=0.5, epsilon=1.0), 4)
    set_errors(replay, 3.0, 0.0, 8.0, 15.0)  # with epsilon 4, 1, 9 and 16, whose roots are 2, 1, 3 and 4
    np.testing.assert_allclose(shares(replay), [0.2, 0.1, 0.3, 0.4], atol=2 / 40_000)
    replay = with_states(prioritised(alpha=0.0), 4)
    set_errors(replay, 100.0, 1.0, 1.0, 1.0)
    np.testing.assert_allclose(shares(replay), [0.25] * 4, atol=2 / 40_000)


def test_draws_are_independent_of_each_other_within_their_parts():
    """Two draws of a batch of two: the first half of the sum holds transition 0, the second the other two."""
    replay = with_states(prioritised(), 3)
    set_errors(replay, 2.0, 1.0, 1.0)
    drawn = torch.cat([replay.sample(2).indices for _ in range(2000)])
    assert (drawn[:, 0] == 0).all()
    seconds = drawn[:, 1].bincount(minlength=3)[1:]
    assert np.square(seconds.numpy() - 1000).sum() / 1000 < 10.8  # chi-square, 1 degree of freedom: once in 1000


@pytest.mark.parametrize("beta", [0.0, 0.5, 1.0])
def test_weights_correct_for_the_chance_to_be_drawn(beta):
    replay = with_states(prioritised(beta=beta), 4)
    set_errors(replay, 4.0, 1.0, 2.0, 1.0)  # 4 P is 2, 1/2, 1 and 1/2; over the greatest of them: 1/4, 1, 1/2 and 1
    batch = replay.sample(64)
    expected = np.array([1 / 4, 1.0, 1 / 2, 1.0])[batch.indices.numpy()] ** beta
    np.testing.assert_allclose(batch.weight[..., 0].numpy(), expected, rtol=1e-6)
    assert (batch.observation[..., 0] == batch.indices).all()


def test_a_new_transition_has_the_greatest_priority_there_was():
    replay = with_states(prioritised(capacity=8), 2)
    np.testing.assert_allclose(shares(replay), [0.5, 0.5], atol=1e-4)
    set_errors(replay, 6.0, 2.0)
    set_errors(replay, 3.0, 2.0)  # the greatest is remembered
    with_states(replay, 1)
    np.testing.assert_allclose(shares(replay), [3 / 11, 2 / 11, 6 / 11], atol=1e-4)
    replay.extend(replay.sample(1))
    np.testing.assert_allclose(shares(replay), [3 / 17, 2 / 17, 6 / 17, 6 / 17], atol=1e-4)


def test_a_transition_that_replaces_another_takes_none_of_its_priority():
    replay = with_states(prioritised(capacity=3), 3)
    set_errors(replay, 0.25, 0.25, 0.5)
    with_states(replay, 1)
    np.testing.assert_allclose(shares(replay), [1 / 1.75, 0.25 / 1.75, 0.5 / 1.75], atol=1e-4)


@pytest.mark.parametrize("capacity", [1, 2, 3, 5, 8, 13])
def test_every_node_of_the_tree_is_the_sum_of_its_leaves(capacity):
    replay, drawing = with_states(prioritised(capacity, (0, 1, 2)), 2 * capacity + 1), np.random.default_rng(capacity)
    for _ in range(20):
        indices = drawing.integers(capacity, size=(3, 4))
        replay.update_priorities(torch.from_numpy(indices), torch.from_numpy(drawing.exponential(size=(3, 4))))
        with_states(replay, int(drawing.integers(3)))
    sums, leaves = replay._sums, replay._leaves
    assert leaves >= capacity
    for node in range(1, leaves):
        torch.testing.assert_close(sums[:, node], sums[:, 2 * node] + sums[:, 2 * node + 1])
    assert (sums[:, leaves : leaves + capacity] > 0.0).all()
    assert not sums[:, leaves + capacity :].any()


def test_no_place_that_is_empty_is_drawn():
    replay = with_states(prioritised(capacity=1000), 7)
    assert set(replay.sample(5000).indices[0].tolist()) == set(range(7))


@pytest.mark.parametrize("errors", [(3.0, 1.0, -9.0), (-9.0, 1.0, 3.0)])
def test_of_two_errors_for_one_transition_the_greater_counts(errors):
    replay = with_states(prioritised(), 2)
    replay.update_priorities(torch.tensor([[0, 1, 0]]), torch.tensor([errors]))
    np.testing.assert_allclose(shares(replay), [9 / 10, 1 / 10], atol=1e-4)


def test_transitions_without_error_are_drawn_while_there_is_no_other():
    replay = with_states(prioritised(), 4)
    set_errors(replay, 0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(shares(replay), [0.25] * 4, atol=1e-4)
    assert torch.isfinite(replay.sample(9).weight).all()
    set_errors(replay, 0.0, 0.0, 2.0, 0.0)
    assert shares(replay).tolist() == [0.0, 0.0, 1.0, 0.0]


def test_priorities_and_weights_have_the_same_bits_wherever_they_lie():
    """Of 13 transitions of 5 seeds none but a few are whole vectors of a processor; alone, others than together."""
    seeds, drawing = (3, 4, 5, 6, 7), torch.Generator().manual_seed(0)
    together = with_states(prioritised(13, seeds, 0.6, 0.4, 1e-3), 13)
    alone = [with_states(prioritised(13, (seed,), 0.6, 0.4, 1e-3), 13) for seed in seeds]
    places = torch.arange(13).expand(5, -1)
    for _ in range(40):
        errors = torch.randn(5, 13, generator=drawing)
        together.update_priorities(places, errors)
        weights = together.sample(13).weight
        for k, replay in enumerate(alone):
            replay.update_priorities(places[k : k + 1], errors[k : k + 1])
            assert torch.equal(together._sums[k], replay._sums[0])
            assert torch.equal(weights[k], replay.sample(13).weight[0])


@pytest.mark.parametrize(("alpha", "beta"), [(0.6, 0.4), (0.7, 1.0), (0.0, 0.5)])
@pytest.mark.parametrize("size", [1, 7, 50])
def test_a_seed_draws_and_weighs_as_it_does_alone_bit_for_bit(alpha, beta, size):
    """Sizes that are no whole number of a processor's vectors, and priorities that float64 does not hold."""
    seeds = (3, 4, 5)
    together = with_states(prioritised(13, seeds, alpha, beta, 1e-3), 17)
    alone = [with_states(prioritised(13, (seed,), alpha, beta, 1e-3), 17) for seed in seeds]
    drawing = torch.Generator().manual_seed(0)
    for _ in range(15):
        batch, errors = together.sample(size), torch.randn(3, size, generator=drawing)
        for k, replay in enumerate(alone):
            for part, own in zip(batch, replay.sample(size), strict=True):
                assert torch.equal(part[k : k + 1], own)
            replay.update_priorities(batch.indices[k : k + 1], errors[k : k + 1])
            with_states(replay, 1)
        together.update_priorities(batch.indices, errors)
        with_states(together, 1)
    assert torch.equal(together._sums, torch.cat([replay._sums for replay in alone]))


@pytest.mark.parametrize("count", [2, 4, 6])
def test_priorities_go_on_from_their_state(count):
    one, other = (with_states(prioritised(4, (0, 9), alpha=0.6, epsilon=1e-3), each) for each in (count, 3))
    one.update_priorities(torch.tensor([[0, 1], [1, 0]]), torch.tensor([[5.0, 0.5], [7.0, 0.25]]))
    state = one.state_dict()
    other.load_state_dict({name: each.clone() if torch.is_tensor(each) else each for name, each in state.items()})
    for replay in (one, other):
        with_states(replay, 1)
    left, right = (replay.sample(50) for replay in (one, other))
    assert all(torch.equal(a, b) for a, b in zip(left, right, strict=True))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"priorities": torch.ones(2, 2)}, r"priorities of shape \(2, 2\); accepted: one for each transition"),
        ({"priorities": torch.ones(1, 3)}, "accepted: one for each transition, 0 or more, not all of them 0"),
        ({"priorities": torch.tensor([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])}, "priorities of shape"),
        ({"priorities": torch.tensor([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]])}, "priorities of shape"),
        ({"greatest": torch.tensor([1.0, 0.0])}, "as the greatest priority; accepted: a number above 0 for each seed"),
        ({"greatest": torch.tensor([1.0])}, "as the greatest priority"),
    ],
)
def test_priorities_that_cannot_be_are_refused(change, said):
    replay = with_states(prioritised(4, (0, 1)), 3)
    before = replay._sums.clone()
    with pytest.raises(RledError, match=said):
        replay.load_state_dict(replay.state_dict() | change)
    assert torch.equal(replay._sums, before)
