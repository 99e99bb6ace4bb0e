"""Weights to drive the Panda with where it does not matter where to."""

from pathlib import Path

import numpy as np
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import Policy
from rled_agent.nn.scaling import scaling_of_bounds
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

DESCRIPTION = reach_task(ROBOTS["panda"]).description


def untrained(path: Path, dropout: float) -> Path:
    """A policy with the networks of the thesis, never trained."""
    network = Perceptron(10, 7, Architecture(dropout=dropout), Draws([0]), squash=True)
    limit = np.full(7, DESCRIPTION.max_delta)
    Policy(network, scaling_of_bounds(DESCRIPTION.observation_bounds(), (-limit, limit)), DESCRIPTION).save(path)
    return path
