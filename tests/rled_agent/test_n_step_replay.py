"""Returns over n steps, worked out by hand with γ = 1/2."""

import numpy as np
import pytest
import torch
from rled_agent.replay.n_step import NStepReplay
from rled_agent.replay.transitions import Source, Step
from rled_agent.replay.uniform import UniformReplay


def make(steps: int = 3) -> NStepReplay:
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
    replay = make()
    for k, reward in enumerate((8.0, 4.0, 2.0, 16.0)):
        assert len(replay) == max(k - 2, 0)
        replay.add(step(k, reward))
    assert stored(replay) == [(0, 8 + 4 / 2 + 2 / 4, 1 / 8, 3), (1, 4 + 2 / 2 + 16 / 4, 1 / 8, 4)]


def test_at_the_end_of_the_task_no_value_follows_and_windows_are_shorter():
    replay = make()
    for k, (reward, end) in enumerate(((8.0, ""), (4.0, ""), (2.0, ""), (16.0, "done"))):
        replay.add(step(k, reward, end))
    assert stored(replay) == [
        (0, 8 + 4 / 2 + 2 / 4, 1 / 8, 3),
        (1, 4 + 2 / 2 + 16 / 4, 0, 4),
        (2, 2 + 16 / 2, 0, 4),
        (3, 16, 0, 4),
    ]


def test_an_episode_that_was_cut_is_followed_by_the_value_of_its_last_state():
    replay = make()
    replay.add(step(0, 8.0))
    replay.add(step(1, 4.0, "cut"))
    assert stored(replay) == [(0, 8 + 4 / 2, 1 / 4, 2), (1, 4, 1 / 2, 2)]


@pytest.mark.parametrize("end", ["done", "cut", "left"])
def test_nothing_is_summed_across_episodes(end):
    replay = make()
    replay.add(step(0, 8.0, "" if end == "left" else end))
    if end == "left":  # nobody saw how it went on
        replay.cut()
    for k in (10, 11, 12):
        replay.add(step(k, 1.0))
    assert stored(replay) == [(0, 8, 0 if end == "done" else 1 / 2, 1), (10, 1 + 1 / 2 + 1 / 4, 1 / 8, 13)]


def test_one_step_is_the_transition_itself():
    replay = make(1)
    replay.add(step(4, 8.0))
    assert stored(replay) == [(4, 8, 1 / 2, 5)]


def test_action_and_source_are_those_of_the_first_step():
    replay = make()
    for k, source in enumerate((Source.EXPERT, Source.AGENT, Source.HUMAN)):
        replay.add(step(k + 1, 0.0, source=source))
    batch = replay.sample(5)
    assert set(batch.action[:, 0].tolist()) == {-1.0}
    assert set(batch.source[:, 0].tolist()) == {Source.EXPERT}


def test_whole_transitions_are_stored_as_they_are():
    replay, other = make(), make()
    for k in range(3):
        replay.add(step(k, 1.0))
    other.extend(replay.sample(2))
    assert stored(other) == 2 * stored(replay)


@pytest.mark.parametrize("cut", range(6))
def test_it_goes_on_from_the_middle_of_a_window(cut):
    """Rewards and discounts that float32 does not hold: a sum is rounded once, whether it was begun before or not."""
    steps = [step(k, 0.1 * k, {2: "done", 4: "cut"}.get(k, ""), Source(k % 3)) for k in range(8)]
    steps = [each._replace(discount=0.95 * (each.discount > 0)) for each in steps]
    whole, begun, resumed = make(), make(), make()
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
