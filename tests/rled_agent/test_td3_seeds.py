"""TD3 of many seeds: each learns what it learns alone, bit for bit, in a sweep too."""

from dataclasses import replace

import pytest
import torch
from rled_agent.learners.actor_losses import Cloning
from rled_agent.learners.td3 import TD3Learner
from rled_agent.nn.architecture import Architecture
from rled_agent.per_seed import merged
from rled_agent.replay.transitions import Transitions
from torch import Tensor

from .td3_cases import CASES, ROWS, TD3, Case, batches, make

ALONE = CASES | {
    "dropout, layer norm": Case(
        replace(TD3, actor=Architecture((33, 17), dropout=0.1), critic=Architecture((33, 17), layer_norm=True))
    ),
    "glorot, leaky": Case(
        replace(TD3, critics=3, actor=Architecture((9,), "leaky_relu", weights="glorot"), critic=Architecture((7,)))
    ),
}


def of_seed(batch: Transitions, seed: int) -> Transitions:
    return Transitions(*(each[seed : seed + 1] for each in batch))


@pytest.mark.parametrize("rows", [ROWS, 9])
@pytest.mark.parametrize("population", [2, 5])
@pytest.mark.parametrize("case", ALONE.values(), ids=ALONE)
def test_a_seed_learns_what_it_learns_alone_bit_for_bit(case, population, rows):
    options = {"actor_loss": case.cloning.loss()}
    together, alone = make(case.config, *range(population), **options), [
        make(case.config, seed, **options) for seed in range(population)
    ]  # fmt: skip
    for batch in batches(8, case.demonstrated, seeds=population, rows=rows):
        if case.weighted:
            batch = batch._replace(weight=batch.reward.abs())
        update = together.update(batch)
        for seed, learner in enumerate(alone):
            own = learner.update(of_seed(batch, seed))
            assert torch.equal(update.td_error[seed : seed + 1], own.td_error)
            for name, each in own.metrics.items():
                assert torch.equal(update.metrics[name][seed : seed + 1], each)
    assert_parts(together, alone)


def assert_parts(together: TD3Learner, alone: list[TD3Learner]) -> None:
    """The state of a population is that of its seeds, one after the other."""
    whole, parts = together.state_dict(), [learner.state_dict() for learner in alone]
    for name, each in whole.items():
        if isinstance(each, Tensor):
            assert torch.equal(each, torch.cat([part[name] for part in parts])), name
        else:
            assert {part[name] for part in parts} == {each}


SWEPT = {
    "actor_rate": (1e-3, 3e-3, 3e-3),
    "critic_rate": (1e-3, 2e-3, 1e-3),
    "rate_decay": (0.0, 4.0, 30.0),
    "tau": (0.005, 0.1, 0.7),
    "target_noise": (0.0, 0.2, 0.3),
    "target_clip": (0.5, 0.1, 0.3),
    "reward_scale": (1.0, 0.1, 0.3),
}


@pytest.mark.parametrize("names", [*((name,) for name in SWEPT), tuple(SWEPT)], ids="-".join)
def test_a_seed_of_a_sweep_learns_what_it_learns_alone_bit_for_bit(names):
    configs = [replace(TD3, **{name: SWEPT[name][k] for name in names}) for k in range(3)]
    together, alone = make(merged(configs), 0, 1, 2), [make(config, k) for k, config in enumerate(configs)]
    for batch in batches(8, seeds=3):
        together.update(batch)
        for seed, learner in enumerate(alone):
            learner.update(of_seed(batch, seed))
    assert_parts(together, alone)


def test_the_weights_of_cloning_may_be_swept():
    cloning = [Cloning(weight) for weight in (0.3, 0.7, 0.0)]
    together = make(TD3, 0, 1, 2, actor_loss=merged(cloning).loss())
    alone = [make(TD3, k, actor_loss=each.loss()) for k, each in enumerate(cloning)]
    for batch in batches(8, 3, seeds=3):
        together.update(batch)
        for seed, learner in enumerate(alone):
            learner.update(of_seed(batch, seed))
    assert_parts(together, alone)
