import numpy as np
import torch
from rled_agent.replay.uniform import Batch, Replay


def fill(replay: Replay, count: int) -> None:
    """Transition k: s = (k, k + 0.1), a = (k + 0.2), r = -k, terminated when 3 divides k, s' = (k + 0.3, k + 0.4)."""
    for k in range(replay.added, replay.added + count):
        state, action, following = np.array([k, k + 0.1]), np.array([k + 0.2]), np.array([k + 0.3, k + 0.4])
        replay.add(state.astype("f4"), action.astype("f4"), -k, k % 3 == 0, following.astype("f4"))


def numbers(replay: Replay) -> list[int]:
    return replay.rows[: len(replay), 0].astype(int).tolist()


def test_the_oldest_transitions_are_overwritten():
    replay = Replay(2, 1, 4)
    fill(replay, 3)
    assert (len(replay), numbers(replay)) == (3, [0, 1, 2])
    fill(replay, 3)
    assert (len(replay), numbers(replay)) == (4, [4, 5, 2, 3])
    assert replay.added == 6


def test_a_batch_shows_the_parts_of_a_transition():
    replay = Replay(2, 1, 10)
    fill(replay, 10)
    batch = replay.sample(64, torch.Generator().manual_seed(0))
    assert len(batch) == 64
    k = batch.observation[:, :1].round()
    torch.testing.assert_close(batch.observation, torch.cat([k, k + 0.1], dim=1))
    torch.testing.assert_close(batch.action, k + 0.2)
    torch.testing.assert_close(batch.reward, -k)
    torch.testing.assert_close(batch.terminated, (k % 3 == 0).float())
    torch.testing.assert_close(batch.next_observation, torch.cat([k + 0.3, k + 0.4], dim=1))


def test_the_parts_are_views_of_the_rows():
    batch = Batch(torch.zeros(3, 7), 2, 1)
    for part in (batch.observation, batch.action, batch.reward, batch.terminated, batch.next_observation):
        part.fill_(1.0)
    assert batch.rows.all()


def test_only_what_was_added_is_drawn_and_all_of_it_equally():
    replay = Replay(2, 1, 1000)
    fill(replay, 20)
    drawn = replay.sample(20_000, torch.Generator().manual_seed(0)).observation[:, 0].numpy().astype(int)
    counts = np.bincount(drawn, minlength=20)
    assert len(counts) == 20
    assert np.square(counts - 1000).sum() / 1000 < 43.8  # chi-square, 19 degrees of freedom: once in 1000 seeds


def test_a_batch_outlives_new_transitions():
    replay = Replay(2, 1, 4)
    fill(replay, 4)
    batch = replay.sample(8, torch.Generator().manual_seed(0))
    before = batch.rows.clone()
    fill(replay, 4)
    assert torch.equal(batch.rows, before)


def test_same_generator_state_draws_the_same_batch():
    replay = Replay(2, 1, 100)
    fill(replay, 100)
    one, same, other = (
        replay.sample(10, torch.Generator().manual_seed(seed)).rows.clone() for seed in (5, 5, 6)
    )  # a batch lasts until the next one of its size
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


def test_batches_of_two_sizes_do_not_share_memory():
    replay = Replay(2, 1, 100)
    fill(replay, 100)
    one = replay.sample(10, torch.Generator().manual_seed(5))
    before = one.rows.clone()
    assert len(replay.sample(11, torch.Generator().manual_seed(6))) == 11
    assert torch.equal(one.rows, before)
