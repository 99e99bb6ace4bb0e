"""The settings people start from: the thesis's two experiments to the letter, and tuned ones beside them."""

from dataclasses import replace

from rled_agent.config import BehaviourConfig, ScheduleConfig, TrainConfig
from rled_agent.learners.td3 import LearnerConfig
from rled_agent.nn.architecture import Architecture

PANDA_BIASED = TrainConfig(
    behaviour=BehaviourConfig(phi=0.1, noise=0.5),
    learner=LearnerConfig(actor=Architecture(weights="glorot"), critic=Architecture(weights="glorot")),
)
"""Section 4.1.3. Weights begin as in TensorFlow, the framework that it names. The exploration noise it does not give:
with that of 4.2.3, a fifth of this one, and PyTorch's first weights, the actor sat in a corner of the action space for
more than 100,000 steps."""

PANDA_TUNED = replace(
    PANDA_BIASED,
    reward="sparse",
    schedule=replace(
        PANDA_BIASED.schedule,
        steps=20_000,
        train_after=1_000,
        train_every=1,
        gradient_steps=1,
        expert_share=0.5,
        evaluate_every=2_000,
    ),
    behaviour=BehaviourConfig(phi=0.1, noise=0.1),
    learner=LearnerConfig(
        gamma=0.9,
        reward_scale=1e-3,
        rate_decay=10_000.0,
        cloning_weight=1.0,
        critic=Architecture(layer_norm=True),
    ),
)
"""Sparse reward: half of each batch comes from the demonstrations, the actor also clones them where the critic agrees,
and the critics are normalised. A target is some four steps away, so γ = 0.9 sees far enough. Values are near 1 then,
and what an action changes of them does not drown in their errors, as it does with γ = 0.99 and rewards of 1000. The
rates fall as Theorem 5 asks: with constant ones a seed lost a target now and then after 60,000 steps."""

PLANAR_MC = TrainConfig(
    env="rled/PlanarReach-v0",
    behaviour=BehaviourConfig(name="gate", threshold=1e-3, measure="qcd", passes=30, noise=0.1),
    schedule=ScheduleConfig(
        steps=50_000,
        train_after=1_000,
        train_every=100,
        gradient_steps=100,
        batch_size=100,
        capacity=50_000,
        evaluate_every=1_000,
        log_every=500,
        checkpoint_every=5_000,
    ),
    learner=LearnerConfig(
        gamma=0.95,
        actor_rate=1e-5,
        critic_rate=1e-5,
        actor=Architecture(hidden=(128, 128), dropout=0.1),
        critic=Architecture(hidden=(128, 128)),
    ),
)
"""Section 4.2.3."""

PLANAR_MC_TUNED = replace(
    PLANAR_MC,
    behaviour=replace(PLANAR_MC.behaviour, threshold=0.1),
    schedule=replace(PLANAR_MC.schedule, steps=20_000, expert_share=0.25),
    learner=replace(
        PLANAR_MC.learner,
        actor_rate=1e-3,
        critic_rate=1e-3,
        cloning_weight=3.0,
        q_filter=False,
        critic=Architecture(hidden=(128, 128), layer_norm=True),
    ),
)
"""Section 4.2.3 with learning rates that learn in a useful time. A quarter of each batch comes from the demonstrations,
whose actions the actor also clones, and the critics are normalised: without these, critics that see nothing but the
expert's actions overrate all others."""

PENDULUM = TrainConfig(
    env="Pendulum-v1",
    reward="own",
    behaviour=BehaviourConfig(phi=0.0),
    schedule=ScheduleConfig(
        steps=20_000, train_after=1_000, train_every=1, gradient_steps=1, batch_size=256, evaluate_every=2_000
    ),
)
"""TD3 on a known task, to see that the learner learns."""

PRESETS: dict[str, tuple[str, TrainConfig]] = {
    "panda_biased": ("biased exploration on the Panda, section 4.1.3 to the letter", PANDA_BIASED),
    "panda_tuned": ("sparse reward with demonstrations in every batch: learns within some thousand steps", PANDA_TUNED),
    "planar_mc": ("Monte-Carlo gate on the planar robot, section 4.2.3 to the letter", PLANAR_MC),
    "planar_mc_tuned": ("the same with learning rates that learn in a useful time", PLANAR_MC_TUNED),
    "pendulum": ("TD3 alone on Pendulum-v1", PENDULUM),
}
