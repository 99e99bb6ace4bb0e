"""Small runs of every method on the planar arm, made by themselves or as a population."""

from dataclasses import replace

import torch
from rled_agent.learners.actor_losses import Cloning
from rled_agent.learners.td3 import TD3Config
from rled_agent.methods.biased_exploration import BiasedExploration
from rled_agent.methods.ddpg import DDPG
from rled_agent.methods.ibrl import IBRL
from rled_agent.methods.jsrl import JSRL
from rled_agent.methods.mc_rled import MCRLED
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.methods.preloading import Preloading
from rled_agent.methods.q_filtered_cloning import QFilteredCloning
from rled_agent.methods.rlpd import RLPD
from rled_agent.methods.td3 import TD3
from rled_agent.nn.architecture import Architecture
from rled_agent.replay.n_step import NStepReplay
from rled_agent.replay.prioritised import PrioritisedReplay
from rled_agent.training.checkpoint import Checkpoint
from rled_agent.training.config import Schedule, TrainConfig
from rled_agent.training.trainer import Trainer

TINY = Architecture(hidden=(12, 10))
SCHEDULE = Schedule(
    steps=400, train_after=40, train_every=20, gradient_steps=10, batch_size=16, capacity=150, evaluation_episodes=2
)
LEARNER = TD3Config(actor=TINY, critic=TINY)
DROPPING = replace(LEARNER, actor=replace(TINY, dropout=0.2))
SHARING = MCRLED(
    measure="iqr",
    threshold=0.03,
    passes=8,
    demonstrated_share=0.25,
    cloning=Cloning(),
    learner=replace(DROPPING, rate_decay=100.0, target_dropout=True),
)


class NStepPrioritised(TD3):
    """TD3 over three steps, from transitions drawn by their errors."""

    def learning(self, problem: Problem) -> Learning:
        plain = super().learning(problem)
        replay = NStepReplay(3, PrioritisedReplay(plain.replay))
        return plain._replace(replay=replay, batches=replay)


METHODS: dict[str, Method] = {
    "td3": TD3(random_steps=25, learner=LEARNER),
    "ddpg": DDPG(learner=replace(LEARNER, critics=1, delay=1, target_noise=0.0)),
    "biased_exploration": BiasedExploration(phi=0.4, learner=DROPPING),
    "mc_rled": MCRLED(measure="iqr", threshold=0.03, passes=8, learner=DROPPING),
    "mc_rled, sharing": SHARING,
    "jsrl": JSRL(guide_steps=9, guide_stages=3, learner=LEARNER),
    "ibrl": IBRL(preload=30, learner=LEARNER),
    "preloading": Preloading(preload=30, learner=LEARNER),
    "q_filtered_cloning": QFilteredCloning(learner=LEARNER),
    "rlpd": RLPD(learner=replace(LEARNER, critic=replace(TINY, layer_norm=True))),
    "n-step, prioritised": NStepPrioritised(learner=LEARNER),
}


def planar(method: Method, **changes: object) -> TrainConfig:
    return TrainConfig(method, **{"env": "rled/PlanarReach-v0", "schedule": SCHEDULE} | changes)


PLAIN = planar(TD3(learner=LEARNER))
STILL = planar(TD3(noise=0.0, learner=replace(LEARNER, actor_rate=0.0)))
BIASED, GATED = planar(METHODS["biased_exploration"]), planar(METHODS["mc_rled"])


def run(trainer: Trainer, steps: int) -> Trainer:
    for _ in range(steps):
        trainer.advance()
    return trainer


def assert_same(one: Checkpoint, other: Checkpoint) -> None:
    assert one.state == other.state
    assert one.tensors.keys() == other.tensors.keys()
    for name, tensor in one.tensors.items():
        assert torch.equal(tensor, other.tensors[name]), name
