"""Small demonstrations and policies of the planar arm."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from rled_agent.data.closed_form import JoinedPoints, joined_points
from rled_agent.data.demonstrations import DemonstrationPoints
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import Policy
from rled_agent.nn.scaling import scaling_of_bounds
from rled_msgs_py.bags import Bag
from rled_msgs_py.task import TaskDescription
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

torch.set_num_threads(1)  # as the commands do: faster on small networks, and the same bits on every machine

THREE_POINTS = np.array([[-0.5, 1.0], [-0.2, 1.25], [-0.5, 1.5]])
"""Joint angles (rad): 0.3 and 0.25, 0.5, 0.3 and 0.25 apart, so 3, 5 and 3 steps of 0.1 rad."""


@pytest.fixture
def double() -> Iterator[None]:
    """Networks made in the test hold float64."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.fixture(scope="session")
def task() -> TaskDescription:
    return reach_task(ROBOTS["planar"]).description


@pytest.fixture(scope="session")
def three_points(task: TaskDescription) -> JoinedPoints:
    chain = ROBOTS["planar"].chain
    return JoinedPoints(task, DemonstrationPoints(chain.position(THREE_POINTS), THREE_POINTS), chain)


@pytest.fixture(scope="session")
def zeta(planar_bag: Path) -> JoinedPoints:
    """ζᵇ of the demonstration bag."""
    return joined_points(Bag(planar_bag))


@pytest.fixture(scope="session")
def make_policy(task: TaskDescription) -> Callable[..., Policy]:
    """A policy of the planar arm with weights drawn from a seed."""

    def make(seed: int = 0, task: TaskDescription = task, **architecture: object) -> Policy:
        settings = Architecture(**{"hidden": (8, 6)} | architecture)
        limit = np.full(task.action_size, task.max_delta)
        observation = task.observation_bounds()
        network = Perceptron(len(observation[0]), task.action_size, settings, Draws([seed]), squash=True)
        return Policy(network, scaling_of_bounds(observation, (-limit, limit)), task)

    return make
