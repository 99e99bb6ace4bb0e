import numpy as np
import pytest
import torch
from rled_agent.replay.transitions import Source, Step, Transitions, concatenated
from rled_agent.replay.uniform import MAX_BYTES, UniformReplay
from rled_msgs_py.errors import RledError


def make(capacity: int, seed: int = 0) -> UniformReplay:
    return UniformReplay(2, 1, capacity, torch.Generator().manual_seed(seed))


def step(k: int) -> Step:
    """s = (k, k + 0.1), a = (k + 0.2), r = -k, γ = 0.5 or 0 where 3 divides k, s' = (k + 0.3, k + 0.4)."""
    state, action, following = (np.array(each, dtype="f4") for each in ([k, k + 0.1], [k + 0.2], [k + 0.3, k + 0.4]))
    return Step(state, action, -k, 0.5 * (k % 3 != 0), following, Source(k % 4))


def fill(replay: UniformReplay, count: int) -> UniformReplay:
    for k in range(replay.added, replay.added + count):
        replay.add(step(k))
    return replay


def numbers(replay: UniformReplay) -> list[int]:
    return replay.rows[: len(replay), 0].astype(int).tolist()


def test_the_oldest_transitions_are_overwritten():
    replay = fill(make(4), 3)
    assert (len(replay), numbers(replay)) == (3, [0, 1, 2])
    fill(replay, 3)
    assert (len(replay), numbers(replay)) == (4, [4, 5, 2, 3])
    assert replay.added == 6


def test_a_batch_shows_the_parts_of_a_transition():
    batch = fill(make(10), 10).sample(64)
    k = batch.observation[:, :1].round()
    assert k.shape == (64, 1)
    torch.testing.assert_close(batch.observation, torch.cat([k, k + 0.1], dim=1))
    torch.testing.assert_close(batch.action, k + 0.2)
    torch.testing.assert_close(batch.reward, -k)
    torch.testing.assert_close(batch.discount, 0.5 * (k % 3 != 0))
    torch.testing.assert_close(batch.next_observation, torch.cat([k + 0.3, k + 0.4], dim=1))
    torch.testing.assert_close(batch.source, k % 4)
    torch.testing.assert_close(batch.demonstrated, (k % 4 >= 2).float())  # of a person, or from before
    assert (batch.weight == 1.0).all()
    assert batch.indices.tolist() == k[:, 0].int().tolist()


def test_transitions_are_stored_as_they_are_in_order_and_the_last_of_too_many():
    drawn = fill(make(10), 10).sample(7)
    whole = torch.cat([*drawn[:6]], dim=1)
    roomy, full, small = make(9), fill(make(9), 5), make(3)
    for replay in (roomy, full, small):
        replay.extend(drawn)
    assert np.array_equal(roomy.rows[:7], whole)
    assert np.array_equal(full.rows[[5, 6, 7, 8, 0, 1, 2]], whole)
    assert np.array_equal(small.rows, whole[-3:])


def test_only_what_was_added_is_drawn_and_all_of_it_equally():
    drawn = fill(make(1000), 20).sample(20_000).observation[:, 0].numpy().astype(int)
    counts = np.bincount(drawn, minlength=20)
    assert len(counts) == 20
    assert np.square(counts - 1000).sum() / 1000 < 43.8  # chi-square, 19 degrees of freedom: once in 1000 seeds


def test_a_batch_outlives_new_transitions():
    replay = fill(make(4), 4)
    batch = replay.sample(8)
    before = batch.observation.clone()
    fill(replay, 4)
    assert torch.equal(batch.observation, before)


def test_same_generator_state_draws_the_same_batch():
    one, same, other = (fill(make(100, seed), 100).sample(10) for seed in (5, 5, 6))
    assert all(torch.equal(left, right) for left, right in zip(one, same, strict=True))
    assert not torch.equal(one.observation, other.observation)


@pytest.mark.parametrize("count", [3, 4, 9])
def test_it_goes_on_from_its_state(count):
    one, other = fill(make(4), count), fill(make(4), 2)
    other.load_state_dict(one.state_dict())
    for replay in (one, other):
        fill(replay, 3)
        replay.generator.manual_seed(3)
    assert one.added == other.added == count + 3
    assert torch.equal(one.sample(20).observation, other.sample(20).observation)


@pytest.mark.parametrize(
    "state",
    [
        {"rows": torch.zeros(3, 7), "added": 3},
        {"rows": torch.zeros(3, 8, 1), "added": 3},
        {"rows": torch.zeros(3, 8), "added": 4},
        {"rows": torch.zeros(5, 8), "added": 5},
    ],
)
def test_a_state_of_other_sizes_or_of_another_count_is_refused_and_nothing_changed(state):
    replay = fill(make(4), 1)
    with pytest.raises(RledError, match=rf"a replay of shape .* after {state['added']} steps; accepted: \(4, 8\)"):
        replay.load_state_dict(state)
    assert numbers(replay) == [0]


def test_a_replay_is_refused_before_it_takes_memory():
    with pytest.raises(RledError, match=r"a replay of 1,000,000,000,000 transitions takes .* GiB; accepted: "):
        make(10**12)
    assert MAX_BYTES > 1 << 28


def test_batches_are_joined_in_order():
    one, other = fill(make(9), 9).sample(2), fill(make(9, seed=1), 5).sample(3)
    joined = concatenated([one, other])
    assert isinstance(joined, Transitions)
    for part, left, right in zip(joined, one, other, strict=True):
        assert torch.equal(part, torch.cat([left, right]))
