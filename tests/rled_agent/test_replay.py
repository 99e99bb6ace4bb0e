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
    """One step a seed: s = (k, k + 0.1), a = (k + 0.2), r = -k, γ = 0.5 or 0 where 3 divides k, s' = s + 0.3."""
    k = torch.tensor(numbers, dtype=torch.float32)
    state, action, following = (
        torch.stack([k + each for each in parts], 1) for parts in ((0, 0.1), (0.2,), (0.3, 0.4))
    )
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


def n_step(steps: int = 3, *seeds: int) -> NStepReplay:
    return NStepReplay(steps, UniformReplay(1, 1, 100, Draws(seeds or (0,))))


def step(number: int, reward: float, end: str = "", source: Source = Source.AGENT) -> Step:
    """Of the state ``number`` to the next, of one seed; ``end`` is done or cut."""
    state, discount = torch.tensor([[float(number)]]), 0.0 if end == "done" else 0.5
    columns = (torch.tensor([each]) for each in (reward, discount))
    return Step(state, -state, *columns, state + 1.0, torch.tensor([float(source)]), torch.tensor([bool(end)]))


def beside(*steps: Step) -> Step:
    """Steps of one seed each as one step of all of them."""
    return Step(*(torch.cat(columns) for columns in zip(*steps, strict=True)))


def stored(replay: NStepReplay, seed: int = 0) -> list[tuple[float, float, float, float]]:
    """s, Σ γᵏ r, what the value of s' counts, and s', of each transition."""
    return [(row[0], row[2], row[3], row[4]) for row in replay._replay.rows[seed, : len(replay)].tolist()]


def followed(replay: NStepReplay, steps: int = 2) -> NStepReplay:
    """So many further steps, of other episodes: those before are stored with them."""
    for k in range(steps):
        replay.add(step(90 + k, 1000.0))
    return replay


def test_a_transition_is_stored_once_those_that_follow_are_known():
    replay = n_step()
    for k, reward in enumerate((8.0, 4.0, 2.0, 16.0)):
        assert len(replay) == max(k - 2, 0)
        replay.add(step(k, reward))
    assert stored(replay) == [(0, 8 + 4 / 2 + 2 / 4, 1 / 8, 3), (1, 4 + 2 / 2 + 16 / 4, 1 / 8, 4)]


@pytest.mark.parametrize("end", ["", "done", "cut"])
def test_as_many_are_stored_whether_an_episode_has_ended_or_not(end):
    replay = n_step()
    for k in range(6):
        replay.add(step(k, 1.0, end if k == 2 else ""))
        assert len(replay) == max(k - 1, 0)


def test_at_the_end_of_the_task_no_value_follows_and_windows_are_shorter():
    replay = n_step()
    for k, (reward, end) in enumerate(((8.0, ""), (4.0, ""), (2.0, ""), (16.0, "done"))):
        replay.add(step(k, reward, end))
    assert stored(followed(replay)) == [
        (0, 8 + 4 / 2 + 2 / 4, 1 / 8, 3),
        (1, 4 + 2 / 2 + 16 / 4, 0, 4),
        (2, 2 + 16 / 2, 0, 4),
        (3, 16, 0, 4),
    ]


def test_an_episode_that_was_cut_is_followed_by_the_value_of_its_last_state():
    replay = n_step()
    replay.add(step(0, 8.0))
    replay.add(step(1, 4.0, "cut"))
    assert stored(followed(replay)) == [(0, 8 + 4 / 2, 1 / 4, 2), (1, 4, 1 / 2, 2)]


@pytest.mark.parametrize("end", ["done", "cut", "left"])
def test_nothing_is_summed_across_episodes(end):
    replay = n_step()
    replay.add(step(0, 8.0, "" if end == "left" else end))
    if end == "left":  # nobody saw how it went on
        replay.cut()
    for k in (10, 11, 12):
        replay.add(step(k, 1.0))
    assert stored(replay) == [(0, 8, 0 if end == "done" else 1 / 2, 1), (10, 1 + 1 / 2 + 1 / 4, 1 / 8, 13)]


def test_episodes_that_were_left_end_with_their_last_step_and_not_before():
    replay = n_step()
    replay.cut()  # there is nothing yet
    for k, reward in enumerate((8.0, 4.0)):
        replay.add(step(k, reward))
    replay.cut()
    assert stored(followed(replay)) == [(0, 8 + 4 / 2, 1 / 4, 2), (1, 4, 1 / 2, 2)]


def test_one_step_is_the_transition_itself():
    replay = n_step(1)
    replay.add(step(4, 8.0))
    assert stored(replay) == [(4, 8, 1 / 2, 5)]


def test_action_and_source_are_those_of_the_first_step():
    replay = n_step()
    for k, source in enumerate((Source.EXPERT, Source.AGENT, Source.HUMAN)):
        replay.add(step(k + 1, 0.0, source=source))
    batch = replay.sample(5)
    assert set(batch.action.view(-1).tolist()) == {-1.0}
    assert set(batch.source.view(-1).tolist()) == {Source.EXPERT}


def test_whole_transitions_are_stored_as_they_are():
    replay, other = n_step(), n_step()
    for k in range(3):
        replay.add(step(k, 1.0))
    other.extend(replay.sample(2))
    assert stored(other) == 2 * stored(replay)


EPISODES = ({2: "done", 4: "cut"}, {1: "cut", 2: "cut", 6: "done"}, {})
"""When episodes of three seeds end."""


def one_of(seed: int, k: int) -> Step:
    """Rewards and discounts that float32 does not hold: a sum is rounded once, whether it was begun before or not."""
    each = step(k + 20 * seed, 0.1 * k + seed, EPISODES[seed].get(k, ""), Source((k + seed) % 3))
    return each._replace(discount=0.95 * (each.discount > 0))


@pytest.mark.parametrize("steps", [1, 2, 3, 5])
def test_a_seed_stores_what_it_stores_alone(steps):
    together, alone = n_step(steps, 0, 1, 2), [n_step(steps) for _ in range(3)]
    for k in range(9):
        together.add(beside(*(one_of(seed, k) for seed in range(3))))
        for seed, replay in enumerate(alone):
            replay.add(one_of(seed, k))
        if k == 4:
            for replay in (together, *alone):
                replay.cut()
        assert [stored(together, seed) for seed in range(3)] == [stored(replay) for replay in alone]
    assert len(together) == 10 - steps


@pytest.mark.parametrize("cut", range(6))
def test_it_goes_on_from_the_middle_of_a_window(cut):
    steps = [beside(*(one_of(seed, k) for seed in range(3))) for k in range(8)]
    whole, begun, resumed = n_step(3, 0, 1, 2), n_step(3, 0, 1, 2), n_step(3, 0, 1, 2)
    for each in steps:
        whole.add(each)
    for each in steps[:cut]:
        begun.add(each)
    state = begun.state_dict()
    assert all(each.shape[0] == 3 for each in state.values() if torch.is_tensor(each))
    resumed.load_state_dict({name: each.clone() if torch.is_tensor(each) else each for name, each in state.items()})
    for each in steps[cut:]:
        resumed.add(each)
    assert [stored(resumed, seed) for seed in range(3)] == [stored(whole, seed) for seed in range(3)]
    for name, each in whole.state_dict().items():
        found = resumed.state_dict()[name]
        assert torch.equal(found, each) if torch.is_tensor(each) else found == each


def test_steps_that_cannot_wait_are_refused():
    replay = n_step(3, 0, 1)
    replay.add(beside(step(0, 1.0), step(5, 2.0)))
    good = replay.state_dict()
    wrong = {
        "more than wait": {name: each.repeat(1, 3, *[1] * (each.ndim - 2)) for name, each in good.items()
                           if name.startswith("waiting.")},
        "of other sizes": {"waiting.observation": torch.zeros(2, 1, 2)},
        "of fewer seeds": {name: each[:1] for name, each in good.items() if name.startswith("waiting.")},
        "not as many of all": {"waiting.action": torch.zeros(2, 2, 1)},
    }  # fmt: skip
    for change in wrong.values():
        with pytest.raises(RledError, match=r"steps that wait, .* numbers each; accepted: 2 at most"):
            n_step(3, 0, 1).load_state_dict(good | change)


# Batches of several buffers: exact shares, and errors that find the way back.


def buffer(source: Source, count: int) -> UniformReplay:
    """Of two seeds."""
    replay = UniformReplay(1, 1, 50, Draws([int(source), 10 + int(source)]))
    for k in range(count):
        replay.add(beside(*2 * [step(k, 0.0, source=source)]))
    return replay


def counted(mixture: Mixture, size: int) -> list[int]:
    """Transitions of each source in a batch, which have to lie in one piece each, in the order of the parts."""
    sources = mixture.sample(size).source[..., 0].int()
    assert (sources.diff(dim=1) >= 0).all()
    assert torch.equal(*sources)
    return sources[0].bincount(minlength=3).tolist()


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
        replay.extend(buffer(source, 5).at(torch.arange(5).expand(2, -1)))
    first, second, third, _ = replays
    mixture = Mixture(first, Part(second, 0.5), Part(third, 0.25))
    batch = mixture.sample(8)
    errors = torch.arange(1.0, 17.0).view(2, 8)
    mixture.update_priorities(batch.indices, errors)
    for replay, drawn in zip((first, second, third), (slice(0, 2), slice(2, 6), slice(6, 8)), strict=True):
        expected = np.ones((2, 5))
        for seed in range(2):  # errors rise in a batch: of several for one, the last is the greatest
            expected[seed, batch.indices[seed, drawn].numpy()] = errors[seed, drawn].numpy()
        np.testing.assert_allclose(replay.state_dict()["priorities"].numpy(), expected, rtol=1e-14)
    assert (replays[3].state_dict()["priorities"] == 1.0).all()


def test_a_buffer_that_a_batch_took_nothing_of_keeps_its_priorities():
    first = PrioritisedReplay(buffer(Source.AGENT, 0), 1.0, 1.0, 0.0)
    first.extend(buffer(Source.AGENT, 3).at(torch.arange(3).expand(2, -1)))
    mixture = Mixture(first, Part(buffer(Source.HUMAN, 4), 1.0))
    batch = mixture.sample(6)
    mixture.update_priorities(batch.indices, torch.full((2, 6), 7.0))
    assert (first.state_dict()["priorities"] == 1.0).all()


def test_a_batch_of_mixtures_is_mixed():
    inner = Mixture(buffer(Source.AGENT, 3), Part(buffer(Source.EXPERT, 3), 0.5))
    assert counted(Mixture(inner, Part(buffer(Source.HUMAN, 3), 0.5)), 8) == [2, 2, 4]
