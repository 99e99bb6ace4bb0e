"""Small policies and runs of the planar arm."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from rled_agent.learners.td3 import TD3Config
from rled_agent.methods.mc_rled import MCRLED
from rled_agent.methods.method import Learning, Problem
from rled_agent.methods.td3 import TD3
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import GateSettings, Origin, Policy
from rled_agent.nn.scaling import scaling_of_bounds
from rled_agent.replay.n_step import NStepReplay
from rled_agent.replay.prioritised import PrioritisedReplay
from rled_agent.training.config import Schedule, TrainConfig
from rled_agent.training.environments import make_batch
from rled_agent.training.trainer import Environments, Trainer
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

TINY = Architecture(hidden=(4, 3))
OTHER = Architecture(hidden=(5,), layer_norm=True, dropout=0.1, activation="leaky_relu")
SCHEDULE = Schedule(steps=40, train_after=4, batch_size=4, capacity=20, log_every=10, evaluate_every=20,
                    checkpoint_every=20)  # fmt: skip
torch.set_num_threads(1)


def config() -> TrainConfig:
    return TrainConfig(
        TD3(random_steps=3, learner=TD3Config(actor=TINY, critic=TINY)), env="rled/PlanarReach-v0", schedule=SCHEDULE
    )


def gated() -> TrainConfig:
    """Settings with all kinds of parts."""
    return replace(config(), method=MCRLED(learner=TD3Config(actor=OTHER, critic=TINY)))


def _learning(problem: Problem) -> Learning:
    """Over three steps, from transitions drawn by their errors: every kind of state."""
    plain = config().method.learning(problem)
    replay = NStepReplay(3, PrioritisedReplay(plain.replay))
    return plain._replace(replay=replay, batches=replay)


@lru_cache
def trainer() -> Trainer:
    envs = [make_batch(config(), None, 1, torch.device("cpu")) for _ in range(2)]
    task, problem = reach_task(ROBOTS["planar"]).description, Problem(4, 2, SCHEDULE.capacity, Draws([0]))
    limit = np.full(2, task.max_delta)
    scaling = scaling_of_bounds(task.observation_bounds(), (-limit, limit))
    learning = _learning(problem)
    strategy = config().method.strategy(problem, learning.learner)
    made = Trainer(Environments(*envs, scaling), learning, strategy, SCHEDULE, has_expert=False)
    for _ in range(12):
        made.advance()
    return made


def policies() -> list[Policy]:
    task, scaling = reach_task(ROBOTS["planar"]).description, trainer().scaling
    draws = Draws([0])
    networks = [
        Perceptron(4, 2, shape, draws, ensemble=members, squash=True) for shape, members in ((TINY, 1), (OTHER, 2))
    ]
    critic = Perceptron(6, 1, TINY, draws, ensemble=2)
    origin = Origin("mc_rled", GateSettings("std", estimator="critics"))
    return [Policy(networks[0], scaling, task), Policy(networks[1], scaling, task, origin, critic)]


@contextmanager
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)
