"""The settings people start from: the thesis's experiments to the letter, tuned ones, and each method with its own."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from rled_agent.learners.actor_losses import Cloning
from rled_agent.learners.td3 import TD3Config
from rled_agent.methods import all_methods
from rled_agent.methods.biased_exploration import BiasedExploration
from rled_agent.methods.mc_rled import MCRLED
from rled_agent.methods.td3 import TD3
from rled_agent.nn.architecture import Architecture
from rled_agent.training.config import Schedule, TrainConfig

PANDA_BIASED = TrainConfig(
    method=BiasedExploration(
        phi=0.1,
        noise=0.5,
        learner=TD3Config(actor=Architecture(weights="glorot"), critic=Architecture(weights="glorot")),
    ),
    reward="dense",
    schedule=Schedule(steps=150_000, train_after=10_000, train_every=1_000, gradient_steps=1_000, evaluate_every=5_000),
)
"""Section 4.1.3. Weights begin as in TensorFlow, the framework that it names. The exploration noise it does not give:
with that of 4.2.3, a fifth of this one, and PyTorch's first weights, the actor sat in a corner of the action space for
more than 100,000 steps."""

PANDA_TUNED = TrainConfig(
    method=BiasedExploration(
        phi=0.1,
        noise=0.1,
        demonstrated_share=0.5,
        cloning=Cloning(1.0),
        learner=TD3Config(gamma=0.9, reward_scale=1e-3, rate_decay=10_000.0, critic=Architecture(layer_norm=True)),
    ),
    reward="sparse",
    schedule=Schedule(steps=20_000),
)
"""Sparse reward: half of each batch comes from the demonstrations, the actor also clones them where the critic agrees,
and the critics are normalised. A target is some four steps away, so γ = 0.9 sees far enough. Values are near 1 then,
and what an action changes of them does not drown in their errors, as it does with γ = 0.99 and rewards of 1000. The
rates fall as Theorem 5 asks: with constant ones a seed lost a target now and then after 60,000 steps."""

PLANAR_LEARNER = TD3Config(
    gamma=0.95,
    actor_rate=1e-5,
    critic_rate=1e-5,
    actor=Architecture(hidden=(128, 128), dropout=0.1),
    critic=Architecture(hidden=(128, 128)),
)
PLANAR_MC = TrainConfig(
    method=MCRLED(threshold=1e-3, measure="qcd", passes=30, noise=0.1, learner=PLANAR_LEARNER),
    env="rled/PlanarReach-v0",
    reward="dense",
    schedule=Schedule(
        steps=50_000,
        train_after=1_000,
        train_every=100,
        gradient_steps=100,
        capacity=50_000,
        evaluate_every=1_000,
        log_every=500,
        checkpoint_every=5_000,
    ),
)
"""Section 4.2.3."""

PLANAR_BIASED = replace(PLANAR_MC, method=BiasedExploration(phi=0.1, noise=0.1, learner=PLANAR_LEARNER))
"""What section 4.2.3 compares with."""

PLANAR_TUNED_LEARNER = replace(
    PLANAR_LEARNER, actor_rate=1e-3, critic_rate=1e-3, critic=Architecture(hidden=(128, 128), layer_norm=True)
)
PLANAR_MC_TUNED = replace(
    PLANAR_MC,
    method=MCRLED(
        threshold=0.1,
        demonstrated_share=0.25,
        cloning=Cloning(3.0, q_filter=False),
        learner=PLANAR_TUNED_LEARNER,
    ),
    schedule=replace(PLANAR_MC.schedule, steps=20_000),
)
"""Section 4.2.3 with learning rates that learn in a useful time. A quarter of each batch comes from the demonstrations,
whose actions the actor also clones, and the critics are normalised: without these, critics that see nothing but the
expert's actions overrate all others."""

PLANAR_BIASED_TUNED = replace(
    PLANAR_MC_TUNED,
    method=BiasedExploration(
        phi=0.1,
        demonstrated_share=0.25,
        cloning=Cloning(3.0, q_filter=False),
        learner=PLANAR_TUNED_LEARNER,
    ),
)
"""The same with biased exploration in place of the gate."""

PENDULUM = TrainConfig(
    method=TD3(random_steps=1_000),
    env="Pendulum-v1",
    reward="own",
    schedule=Schedule(steps=20_000, batch_size=256),
)
"""TD3 on a known task, to see that the learner learns."""


class Preset(NamedTuple):
    """Settings with a name.

    Attributes:
        summary: one line.
        config: the settings.
    """

    summary: str
    config: TrainConfig


PRESETS: Mapping[str, Preset] = {
    "panda_biased": Preset("biased exploration on the Panda, section 4.1.3 to the letter", PANDA_BIASED),
    "panda_tuned": Preset("sparse reward, demonstrations in every batch: learns in some thousand steps", PANDA_TUNED),
    "planar_mc": Preset("Monte-Carlo gate on the planar robot, section 4.2.3 to the letter", PLANAR_MC),
    "planar_mc_tuned": Preset("the same with learning rates that learn in a useful time", PLANAR_MC_TUNED),
    "planar_biased": Preset("what planar_mc is compared with: biased exploration", PLANAR_BIASED),
    "planar_biased_tuned": Preset("what planar_mc_tuned is compared with: biased exploration", PLANAR_BIASED_TUNED),
    "pendulum": Preset("TD3 alone on Pendulum-v1", PENDULUM),
}


def all_presets() -> Mapping[str, Preset]:
    """The presets, and each method with its own settings on the Panda's task with a sparse reward."""
    return {**PRESETS, **{name: Preset(method.title, TrainConfig(method())) for name, method in all_methods().items()}}
