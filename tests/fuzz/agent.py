"""Small policies and runs of the planar arm."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from rled_agent.architecture import Architecture
from rled_agent.config import BehaviourConfig, ScheduleConfig, TrainConfig
from rled_agent.environments import make_environment
from rled_agent.expertise import no_expertise
from rled_agent.learner import LearnerConfig
from rled_agent.networks import Network
from rled_agent.policy import Policy
from rled_agent.scaling import scaling_of_bounds
from rled_agent.trainer import Trainer
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

TINY = Architecture(hidden=(4, 3))
CONFIG = TrainConfig(
    env="rled/PlanarReach-v0",
    behaviour=BehaviourConfig(phi=0.0),
    schedule=ScheduleConfig(steps=40, capacity=20, log_every=10, evaluate_every=20, checkpoint_every=20),
    learner=LearnerConfig(actor=TINY, critic=TINY),
)
torch.set_num_threads(1)


def policy(architecture: Architecture = TINY) -> Policy:
    task = reach_task(ROBOTS["planar"]).description
    observation, limit = task.observation_bounds(), np.full(task.action_size, task.max_delta)
    generator = torch.Generator().manual_seed(1)
    network = Network(len(observation[0]), task.action_size, architecture, generator, squash=True)
    return Policy(network, scaling_of_bounds(observation, (-limit, limit)), task)


def policies() -> list[Policy]:
    return [policy(), policy(replace(TINY, hidden=(5,), layer_norm=True, dropout=0.1, activation="leaky_relu"))]


@lru_cache
def trainer() -> Trainer:
    envs = make_environment(CONFIG, None), make_environment(CONFIG, None)
    made = Trainer(*envs, CONFIG, no_expertise(envs[1], CONFIG))
    for _ in range(12):
        made.advance()
    return made


@contextmanager
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)
