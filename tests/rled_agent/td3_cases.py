"""What the tests of TD3 learn: random batches, and the cases of the update."""

from dataclasses import replace
from typing import NamedTuple

import torch
from rled_agent.learners.actor_losses import Cloning
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.replay.transitions import Source, Transitions

SMALL = Architecture(hidden=(6, 5))
TD3 = TD3Config(gamma=0.9, actor_rate=3e-3, critic_rate=2e-3, tau=0.05, actor=SMALL, critic=SMALL)
DDPG = replace(TD3, critics=1, delay=1, target_noise=0.0)
OBSERVATION, ACTION, ROWS = 4, 2, 8


def make(config: TD3Config, *seeds: int, **options) -> TD3Learner:
    """Of each seed, of 0 where none is named."""
    return TD3Learner(OBSERVATION, ACTION, config, Draws(seeds or (0,)), **options)


def transitions(observation, action, reward, discount, following, source=Source.AGENT) -> Transitions:
    """A batch of rows, each of weight 1; every part (P, b, ...)."""
    ones = torch.ones_like(reward)
    sources, indices = ones * float(source), torch.zeros(reward.shape[:2]).long()
    return Transitions(observation, action, reward, discount, following, sources, ones, indices)


def batches(
    count: int, demonstrated: int = 0, gamma: float = 0.9, seeds: int = 1, rows: int = ROWS
) -> list[Transitions]:
    """Random transitions, a third of them final, the last so many of each batch demonstrated."""
    drawing, found = torch.Generator().manual_seed(11), []
    for _ in range(count):
        s, a, r, d, following = (
            torch.randn(seeds, rows, width, generator=drawing) for width in (OBSERVATION, ACTION, 1, 1, OBSERVATION)
        )
        each = transitions(s, a.tanh(), r, gamma * (d < 0.5), following)
        each.source[:, rows - demonstrated :] = Source.DEMONSTRATION
        found.append(each)
    return found


class Case(NamedTuple):
    """What is compared."""

    config: TD3Config
    cloning: Cloning = Cloning(0.0)
    demonstrated: int = 0
    weighted: bool = False


DROPPING = replace(SMALL, dropout=0.3)
CASES = {
    "ddpg": Case(DDPG),
    "td3": Case(TD3),
    "scaled rewards": Case(replace(TD3, reward_scale=0.125)),
    "decaying rates": Case(replace(TD3, delay=3, rate_decay=4.0)),
    "ddpg, decaying rates": Case(replace(DDPG, rate_decay=4.0)),
    "actor dropout": Case(replace(TD3, actor=DROPPING)),
    "target dropout": Case(replace(TD3, actor=DROPPING, target_dropout=True)),
    "weighted": Case(TD3, weighted=True),
    "cloning, filtered": Case(TD3, Cloning(0.7), 3),
    "cloning": Case(TD3, Cloning(0.7, q_filter=False), 3),
    "cloning, nothing demonstrated": Case(TD3, Cloning(0.7), 0),
    "ddpg, cloning every row": Case(DDPG, Cloning(2.0), ROWS),
}
