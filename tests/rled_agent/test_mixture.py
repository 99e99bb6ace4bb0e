"""Batches of several buffers: exact shares, and errors that find the way back."""

import numpy as np
import pytest
import torch
from rled_agent.replay.mixture import Mixture, Part
from rled_agent.replay.prioritised import PrioritisedReplay
from rled_agent.replay.transitions import Source, Step
from rled_agent.replay.uniform import UniformReplay


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
