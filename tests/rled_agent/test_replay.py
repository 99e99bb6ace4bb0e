"""Replay: uniform, over n steps, prioritised and mixed, against what is worked out by hand."""

import numpy as np
import pytest
import torch
from rled_agent.nn.draws import Draws
from rled_agent.replay.mixture import Mixture, Part
from rled_agent.replay.n_step import NStepReplay
from rled_agent.replay.prioritised import PrioritisedReplay
from rled_agent.replay.transitions import Source, Step, Transitions, concatenated
from rled_agent.replay.uniform import MAX_BYTES, UniformReplay
from rled_msgs_py.errors import RledError


def uniform(capacity: int, *seeds: int) -> UniformReplay:
    """A replay of each seed, of 0 where none is named."""
    return UniformReplay(2, 1, capacity, Draws(seeds or (0,)))


def numbered(*numbers: int) -> Step:
    """One step a seed: s = (k, k + 0.1), a = (k + 0.2), r = -k, γ = 0.5 or 0 where 3 divides k, s' = (k + 0.3, k + 0.4)."""
    k = torch.tensor(numbers, dtype=torch.float32)
    state, action, following = (torch.stack([k + each for each in parts], 1) for parts in ((0, 0.1), (0.2,), (0.3, 0.4)))
    return Step(state, action, -k, 0.5 * (k % 3 != 0), following, k % 4, torch.zeros_like(k, dtype=torch.bool))


def filled(replay: UniformReplay, count: int) -> UniformReplay:
    """The steps that the first seed takes are numbered from 0, those of the second from 1000, and so on."""
    for k in range(replay.added, replay.added + count):
        replay.add(numbered(*(k + 1000 * seed for seed in range(len(replay.rows)))))
    return replay


def numbers(replay: UniformReplay, seed: int = 0) -> list[int]:
    return replay.rows[seed, : len(replay), 0].int().tolist()


def test_the_oldest_transitions_are_overwritten():
    replay = filled(uniform(4, 0, 1), 3)
    assert (len(replay), numbers(replay), numbers(replay, 1)) == (3, [0, 1, 2], [1000, 1001, 1002])
    filled(replay, 3)
    assert (len(replay), numbers(replay), numbers(replay, 1)) == (4, [4, 5, 2, 3], [1004, 1005, 1002, 1003])
    assert replay.added == 6


def test_a_batch_shows_the_parts_of_a_transition():
    batch = filled(uniform(10, 0, 1), 10).sample(64)
    k = batch.observation[..., :1].round()
    assert k.shape == (2, 64, 1)
    assert ((k >= 1000.0) == torch.tensor([False, True]).view(2, 1, 1)).all()
    torch.testing.assert_close(batch.observation, torch.cat([k, k + 0.1], dim=2))
    torch.testing.assert_close(batch.action, k + 0.2)
    torch.testing.assert_close(batch.reward, -k)
    torch.testing.assert_close(batch.discount, 0.5 * (k % 3 != 0))
    torch.testing.assert_close(batch.next_observation, torch.cat([k + 0.3, k + 0.4], dim=2))
    torch.testing.assert_close(batch.source, k % 4)
    torch.testing.assert_close(batch.demonstrated, (k % 4 >= 2).float())  # of a person, or from before
    assert (batch.weight == 1.0).all()
    assert batch.indices.tolist() == (k[..., 0].int() % 1000).tolist()


def test_transitions_are_stored_as_they_are_in_order_and_the_last_of_too_many():
    drawn = filled(uniform(10, 0, 1), 10).sample(7)
    whole = torch.cat([*drawn[:6]], dim=2)
    assert torch.equal(drawn.rows(), whole)
    roomy, full, small = uniform(9, 0, 1), filled(uniform(9, 0, 1), 5), uniform(3, 0, 1)
    for replay in (roomy, full, small):
        replay.extend(drawn)
    assert torch.equal(roomy.rows[:, :7], whole)
    assert torch.equal(full.rows[:, [5, 6, 7, 8, 0, 1, 2]], whole)
    assert torch.equal(small.rows, whole[:, -3:])


def test_only_what_was_added_is_drawn_and_all_of_it_equally():
    drawn = filled(uniform(1000, 3, 4), 20).sample(20_000).observation[..., 0].int() - torch.tensor([[0], [1000]])
    for each in drawn.tolist():
        counts = np.bincount(each, minlength=20)
        assert len(counts) == 20
        assert np.square(counts - 1000).sum() / 1000 < 43.8  # chi-square, 19 degrees of freedom: once in 1000 seeds


def test_a_batch_outlives_new_transitions():
    replay = filled(uniform(4), 4)
    batch = replay.sample(8)
    before = batch.observation.clone()
    filled(replay, 4)
    assert torch.equal(batch.observation, before)


def test_same_seed_draws_the_same_batch():
    one, same, other = (filled(uniform(100, seed), 100).sample(10) for seed in (5, 5, 6))
    assert all(torch.equal(left, right) for left, right in zip(one, same, strict=True))
    assert not torch.equal(one.observation, other.observation)


def test_a_seed_draws_the_transitions_that_it_draws_alone():
    together, seeds = filled(uniform(8, 5, 6, 7), 12), (5, 6, 7)
    alone = [uniform(8, seed) for seed in seeds]
    for k, replay in enumerate(alone):
        for number in range(12):
            replay.add(numbered(number + 1000 * k))
    for size in (1, 7, 30):
        batch = together.sample(size)
        for k, replay in enumerate(alone):
            for part, own in zip(batch, replay.sample(size), strict=True):
                assert torch.equal(part[k : k + 1], own)


@pytest.mark.parametrize("count", [3, 4, 9])
def test_it_goes_on_from_its_state(count):
    one, other = filled(uniform(4, 3, 8), count), filled(uniform(4, 3, 8), 2)
    other.load_state_dict(one.state_dict())
    for replay in (one, other):
        filled(replay, 3)
    assert one.added == other.added == count + 3
    assert torch.equal(one.sample(20).observation, other.sample(20).observation)


@pytest.mark.parametrize(
    "state",
    [
        {"rows": torch.zeros(1, 3, 7), "added": 3},
        {"rows": torch.zeros(3, 8), "added": 3},
        {"rows": torch.zeros(1, 3, 8), "added": 4},
        {"rows": torch.zeros(1, 5, 8), "added": 5},
        {"rows": torch.zeros(2, 3, 8), "added": 3},
    ],
)
def test_a_state_of_other_sizes_or_of_another_count_is_refused_and_nothing_changed(state):
    replay = filled(uniform(4), 1)
    held = rf"\(1, {min(state['added'], 4)}, 8\)"
    with pytest.raises(RledError, match=rf"a replay of shape .* after {state['added']} steps; accepted: {held}"):
        replay.load_state_dict(state)
    assert numbers(replay) == [0]


def test_a_replay_is_refused_before_it_takes_memory():
    with pytest.raises(RledError, match=r"a replay of 1,000,000,000,000 transitions takes .* GiB; accepted: "):
        uniform(10**12)
    with pytest.raises(RledError, match=r"a replay of 4,000,000,000,000 transitions takes"):
        uniform(10**12, 0, 1, 2, 3)
    assert MAX_BYTES > 1 << 28


def test_batches_are_joined_in_order():
    one, other = filled(uniform(9, 0, 1), 9).sample(2), filled(uniform(9, 2, 3), 5).sample(3)
    joined = concatenated([one, other])
    assert isinstance(joined, Transitions)
    for part, left, right in zip(joined, one, other, strict=True):
        assert torch.equal(part, torch.cat([left, right], dim=1))


# Returns over n steps, worked out by hand with γ = 1/2.


def n_step(steps: int = 3) -> NStepReplay:
    return NStepReplay(steps, UniformReplay(1, 1, 100, torch.Generator().manual_seed(0)))


def step(number: int, reward: float, end: str = "", source: Source = Source.AGENT) -> Step:
    """Of the state ``number`` to the next; ``end`` is done or cut."""
    state, following = np.array([number], np.float32), np.array([number + 1], np.float32)
    discount = 0.0 if end == "done" else 0.5
    return Step(state, -state, reward, discount, following, source, bool(end))


def stored(replay: NStepReplay) -> list[tuple[float, float, float, float]]:
    """s, Σ γᵏ r, what the value of s' counts, and s', of each transition."""
    return [(row[0], row[2], row[3], row[4]) for row in replay._replay.rows[: len(replay)].tolist()]


def test_a_transition_is_stored_once_those_that_follow_are_known():
    replay = n_step()
    for k, reward in enumerate((8.0, 4.0, 2.0, 16.0)):
        assert len(replay) == max(k - 2, 0)
        replay.add(step(k, reward))
    assert stored(replay) == [(0, 8 + 4 / 2 + 2 / 4, 1 / 8, 3), (1, 4 + 2 / 2 + 16 / 4, 1 / 8, 4)]


def test_at_the_end_of_the_task_no_value_follows_and_windows_are_shorter():
    replay = n_step()
    for k, (reward, end) in enumerate(((8.0, ""), (4.0, ""), (2.0, ""), (16.0, "done"))):
        replay.add(step(k, reward, end))
    assert stored(replay) == [
        (0, 8 + 4 / 2 + 2 / 4, 1 / 8, 3),
        (1, 4 + 2 / 2 + 16 / 4, 0, 4),
        (2, 2 + 16 / 2, 0, 4),
        (3, 16, 0, 4),
    ]


def test_an_episode_that_was_cut_is_followed_by_the_value_of_its_last_state():
    replay = n_step()
    replay.add(step(0, 8.0))
    replay.add(step(1, 4.0, "cut"))
    assert stored(replay) == [(0, 8 + 4 / 2, 1 / 4, 2), (1, 4, 1 / 2, 2)]


@pytest.mark.parametrize("end", ["done", "cut", "left"])
def test_nothing_is_summed_across_episodes(end):
    replay = n_step()
    replay.add(step(0, 8.0, "" if end == "left" else end))
    if end == "left":  # nobody saw how it went on
        replay.cut()
    for k in (10, 11, 12):
        replay.add(step(k, 1.0))
    assert stored(replay) == [(0, 8, 0 if end == "done" else 1 / 2, 1), (10, 1 + 1 / 2 + 1 / 4, 1 / 8, 13)]


def test_one_step_is_the_transition_itself():
    replay = n_step(1)
    replay.add(step(4, 8.0))
    assert stored(replay) == [(4, 8, 1 / 2, 5)]


def test_action_and_source_are_those_of_the_first_step():
    replay = n_step()
    for k, source in enumerate((Source.EXPERT, Source.AGENT, Source.HUMAN)):
        replay.add(step(k + 1, 0.0, source=source))
    batch = replay.sample(5)
    assert set(batch.action[:, 0].tolist()) == {-1.0}
    assert set(batch.source[:, 0].tolist()) == {Source.EXPERT}


def test_whole_transitions_are_stored_as_they_are():
    replay, other = n_step(), n_step()
    for k in range(3):
        replay.add(step(k, 1.0))
    other.extend(replay.sample(2))
    assert stored(other) == 2 * stored(replay)


@pytest.mark.parametrize("cut", range(6))
def test_it_goes_on_from_the_middle_of_a_window(cut):
    """Rewards and discounts that float32 does not hold: a sum is rounded once, whether it was begun before or not."""
    steps = [step(k, 0.1 * k, {2: "done", 4: "cut"}.get(k, ""), Source(k % 3)) for k in range(8)]
    steps = [each._replace(discount=0.95 * (each.discount > 0)) for each in steps]
    whole, begun, resumed = n_step(), n_step(), n_step()
    for each in steps:
        whole.add(each)
    for each in steps[:cut]:
        begun.add(each)
    state = begun.state_dict()
    resumed.load_state_dict({name: each.clone() if torch.is_tensor(each) else each for name, each in state.items()})
    for each in steps[cut:]:
        resumed.add(each)
    assert stored(resumed) == stored(whole)
    assert resumed.state_dict()["waiting.source"].tolist() == whole.state_dict()["waiting.source"].tolist()


# Prioritised replay against probabilities, weights and sums worked out by hand.


def prioritised(capacity: int = 4, seed: int = 0, alpha: float = 1.0, beta: float = 1.0, epsilon: float = 0.0):
    return PrioritisedReplay(UniformReplay(1, 1, capacity, torch.Generator().manual_seed(seed)), alpha, beta, epsilon)


def with_states(replay: PrioritisedReplay, count: int) -> PrioritisedReplay:
    for k in range(count):
        replay.add(Step(np.array([k], np.float32), np.zeros(1, np.float32), 0.0, 1.0, np.zeros(1, np.float32)))
    return replay


def set_errors(replay: PrioritisedReplay, *errors: float) -> None:
    replay.update_priorities(torch.arange(len(errors)), torch.tensor(errors))


def shares(replay: PrioritisedReplay, size: int = 40_000) -> np.ndarray:
    return np.bincount(replay.sample(size).indices.numpy(), minlength=len(replay)) / size


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
    drawn = torch.stack([replay.sample(2).indices for _ in range(2000)])
    assert (drawn[:, 0] == 0).all()
    seconds = drawn[:, 1].bincount(minlength=3)[1:]
    assert np.square(seconds.numpy() - 1000).sum() / 1000 < 10.8  # chi-square, 1 degree of freedom: once in 1000


@pytest.mark.parametrize("beta", [0.0, 0.5, 1.0])
def test_weights_correct_for_the_chance_to_be_drawn(beta):
    replay = with_states(prioritised(beta=beta), 4)
    set_errors(replay, 4.0, 1.0, 2.0, 1.0)  # 4 P is 2, 1/2, 1 and 1/2; over the greatest of them: 1/4, 1, 1/2 and 1
    batch = replay.sample(64)
    expected = np.array([1 / 4, 1.0, 1 / 2, 1.0])[batch.indices.numpy()] ** beta
    np.testing.assert_allclose(batch.weight[:, 0].numpy(), expected, rtol=1e-6)
    assert (batch.observation[:, 0] == batch.indices).all()


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
    replay, drawing = with_states(prioritised(capacity), 2 * capacity + 1), np.random.default_rng(capacity)
    for _ in range(20):
        indices = drawing.integers(capacity, size=4)
        replay.update_priorities(torch.from_numpy(indices), torch.from_numpy(drawing.exponential(size=4)))
        with_states(replay, int(drawing.integers(3)))
    sums, leaves = replay._sums, replay._leaves
    assert leaves >= capacity
    for node in range(1, leaves):
        assert sums[node] == pytest.approx(sums[2 * node] + sums[2 * node + 1])
    assert (sums[leaves : leaves + capacity] > 0.0).all()
    assert not sums[leaves + capacity :].any()


def test_no_place_that_is_empty_is_drawn():
    replay = with_states(prioritised(capacity=1000), 7)
    assert set(replay.sample(5000).indices.tolist()) == set(range(7))


def test_of_two_errors_for_one_transition_the_last_counts():
    replay = with_states(prioritised(), 2)
    replay.update_priorities(torch.tensor([0, 1, 0]), torch.tensor([9.0, 1.0, 3.0]))
    np.testing.assert_allclose(shares(replay), [3 / 4, 1 / 4], atol=1e-4)


@pytest.mark.parametrize("count", [2, 4, 6])
def test_priorities_go_on_from_their_state(count):
    one, other = (with_states(prioritised(alpha=0.6, epsilon=1e-3), each) for each in (count, 3))
    set_errors(one, 5.0, 0.5)
    state = one.state_dict()
    other.load_state_dict({name: each.clone() if torch.is_tensor(each) else each for name, each in state.items()})
    for replay in (one, other):
        with_states(replay, 1)
        replay._replay.generator.manual_seed(3)
    left, right = (replay.sample(50) for replay in (one, other))
    assert all(torch.equal(a, b) for a, b in zip(left, right, strict=True))


# Batches of several buffers: exact shares, and errors that find the way back.


def buffer(source: Source, count: int) -> UniformReplay:
    replay = UniformReplay(1, 1, 50, torch.Generator().manual_seed(int(source)))
    for k in range(count):
        state = np.array([k], np.float32)
        replay.add(Step(state, state, 0.0, 1.0, state, source))
    return replay


def counted(mixture: Mixture, size: int) -> list[int]:
    """Transitions of each source in a batch, which have to lie in one piece each, in the order of the parts."""
    sources = mixture.sample(size).source[:, 0].int()
    assert (sources.diff() >= 0).all()
    return sources.bincount(minlength=3).tolist()


@pytest.mark.parametrize(("size", "expected"), [(8, [3, 4, 1]), (100, [38, 50, 12]), (1, [1, 0, 0]), (7, [2, 4, 1])])
def test_shares_are_exact_and_the_first_buffer_gives_the_rest(size, expected):
    parts = Part(buffer(Source.EXPERT, 5), 0.5), Part(buffer(Source.HUMAN, 5), 0.125)
    mixture = Mixture(buffer(Source.AGENT, 5), *parts)
    assert len(mixture) == 15
    for _ in range(3):
        assert counted(mixture, size) == expected


def test_an_empty_buffer_gives_nothing_until_there_is_something_in_it():
    people = buffer(Source.HUMAN, 0)
    mixture = Mixture(buffer(Source.AGENT, 5), Part(people, 0.25))
    assert counted(mixture, 8) == [8, 0, 0]
    people.extend(buffer(Source.HUMAN, 1).sample(1))
    assert counted(mixture, 8) == [6, 0, 2]


def test_the_errors_of_a_batch_are_the_priorities_of_the_buffers_that_it_came_from():
    replays = [PrioritisedReplay(buffer(source, 0), 1.0, 1.0, 0.0) for source in Source]
    for replay, source in zip(replays, Source, strict=True):
        replay.extend(buffer(source, 5).at(torch.arange(5)))
    first, second, third, _ = replays
    mixture = Mixture(first, Part(second, 0.5), Part(third, 0.25))
    batch = mixture.sample(8)
    errors = torch.arange(1.0, 9.0)
    mixture.update_priorities(batch.indices, errors)
    for replay, drawn in zip((first, second, third), (slice(0, 2), slice(2, 6), slice(6, 8)), strict=True):
        expected = np.ones(5)
        expected[batch.indices[drawn].numpy()] = errors[drawn].numpy()  # of several for one, the last
        np.testing.assert_array_equal(replay.state_dict()["priorities"].numpy(), expected)
    assert (replays[3].state_dict()["priorities"] == 1.0).all()


def test_a_buffer_that_a_batch_took_nothing_of_keeps_its_priorities():
    first = PrioritisedReplay(buffer(Source.AGENT, 0), 1.0, 1.0, 0.0)
    first.extend(buffer(Source.AGENT, 3).at(torch.arange(3)))
    mixture = Mixture(first, Part(buffer(Source.HUMAN, 4), 1.0))
    batch = mixture.sample(6)
    mixture.update_priorities(batch.indices, torch.full((6,), 7.0))
    assert (first.state_dict()["priorities"] == 1.0).all()


def test_a_batch_of_mixtures_is_mixed():
    inner = Mixture(buffer(Source.AGENT, 3), Part(buffer(Source.EXPERT, 3), 0.5))
    assert counted(Mixture(inner, Part(buffer(Source.HUMAN, 3), 0.5)), 8) == [2, 2, 4]
