"""Small policies and runs of the planar arm."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
from rled_agent.training.config import TrainConfig
from rled_agent.training.environments import make_environment
from rled_agent.training.expertise import no_expertise
from rled_agent.nn.policy import Policy
from rled_agent.training.trainer import Trainer
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

TINY = {"hidden": [4, 3]}
OTHER = {"hidden": [5], "layer_norm": True, "dropout": 0.1, "activation": "leaky_relu"}
SCHEDULE = {"steps": 40, "capacity": 20, "log_every": 10, "evaluate_every": 20, "checkpoint_every": 20}
torch.set_num_threads(1)


def config(actor: dict[str, Any] = TINY) -> TrainConfig:
    values = TrainConfig().to_dict() | {"env": "rled/PlanarReach-v0"}
    values["behaviour"] |= {"phi": 0.0}
    values["schedule"] |= SCHEDULE
    values["learner"]["actor"] |= actor
    values["learner"]["critic"] |= TINY
    return TrainConfig.from_dict(values)


def new_trainer(settings: TrainConfig) -> Trainer:
    envs = make_environment(settings, None), make_environment(settings, None)
    return Trainer(*envs, settings, no_expertise(envs[1], settings))


@lru_cache
def trainer() -> Trainer:
    made = new_trainer(config())
    for _ in range(12):
        made.advance()
    return made


def policies() -> list[Policy]:
    task = reach_task(ROBOTS["planar"]).description
    made = [new_trainer(config(actor)) for actor in (TINY, OTHER)]
    return [Policy(each.learner.actor, each.expertise.scaling, task) for each in made]


@contextmanager
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)
