"""Behavioural cloning: the estimated expert policy π̂ᵈ_ω (Eq. 4.10)."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
import torch
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.validation import Range, check_fields
from torch import Tensor

from rled_agent.bounds import Count, Share
from rled_agent.data.demonstrations import Demonstrations, StateActions
from rled_agent.nn.adam import Adam
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import Policy
from rled_agent.nn.scaling import Scaling, scaling_of_samples

CHUNK = 64
"""Batches drawn at once: the closed form of ζᵇ is cheapest in large arrays."""


@dataclass(frozen=True)
class CloningConfig:
    """How the expert is cloned: the network and its training, by section 4.1.3."""

    architecture: Architecture = field(default_factory=lambda: Architecture(activation="leaky_relu"))
    """hidden part of the network"""
    learning_rate: Share = 1e-3
    """of Adam at the start; it falls to zero along a cosine"""
    batch_size: Annotated[int, Range(1, 1_000_000)] = 256
    """pairs in a gradient step"""
    steps: Count = 20_000
    """gradient steps"""
    validation_share: Share = 0.1
    """share of the demonstrated trajectories set aside"""
    validate_every: Count = 250
    """gradient steps between validations"""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.architecture.dropout:
            raise ContractError(f"architecture.dropout is {self.architecture.dropout}", "0", "cloning drops no units")


class CurvePoint(NamedTuple):
    """One point of the learning curve, losses in normalised actions.

    Attributes:
        step: gradient steps taken.
        train: mean J_d over the batches since the last point.
        validation: J_d on trajectories set aside.
    """

    step: int
    train: float
    validation: float


def clone_expert(
    demonstrations: Demonstrations,
    config: CloningConfig,
    generator: np.random.Generator,
    progress: Callable[[CurvePoint], None],
) -> tuple[Policy, list[CurvePoint]]:
    """Fit π̂ᵈ_ω to demonstrated pairs by mean squared error (Eq. 4.10).

    Args:
        demonstrations: ζᵇ.
        config: settings.
        generator: draws weights, split and batches; the same state gives the same policy.
        progress: told each point of the curve.

    Returns:
        The policy and its learning curve.

    Raises:
        RledError: too few trajectories to set any aside, or a loss that is no number.
    """
    rest, aside = demonstrations.split(config.validation_share, generator)
    if not len(rest) or not len(aside):
        raise RledError("too few demonstrated trajectories to set some aside", "at least 2", "record more")
    scaling = _scaling(rest, generator)
    network = _network(rest, config, generator)
    optimizer = Adam(network, [1])
    validation = _tensors(aside.sample(8192, generator), scaling)
    curve: list[CurvePoint] = []
    losses: list[Tensor] = []
    for k, (observations, actions) in enumerate(_batches(rest, scaling, config, generator), start=1):
        loss = _cloning_loss(network(observations)[0] - actions)
        optimizer.step(loss, [config.learning_rate * 0.5 * (1.0 + math.cos(math.pi * (k - 1) / config.steps))])
        losses.append(loss.detach())
        if k % config.validate_every == 0 or k == config.steps:
            curve.append(_validate(k, network, validation, losses))
            progress(curve[-1])
            losses.clear()
    return Policy(network, scaling, demonstrations.task), curve


def _cloning_loss(error: Tensor) -> Tensor:
    """J_d = (1/|B_d|) Σ ‖π̂ᵈ_ω(s) − a‖² (Eq. 4.10), of errors of shape (b, n)."""
    return error.square().sum(dim=1).mean()


def _scaling(demonstrations: Demonstrations, generator: np.random.Generator) -> Scaling:
    limit = np.full(demonstrations.task.action_size, demonstrations.task.max_delta)
    return scaling_of_samples(demonstrations.sample(50_000, generator).observations, (-limit, limit))


def _network(demonstrations: Demonstrations, config: CloningConfig, generator: np.random.Generator) -> Perceptron:
    task = demonstrations.task
    weights = Draws([int(generator.integers(2**63))])
    observation_size = len(task.observation_bounds()[0])
    return Perceptron(observation_size, task.action_size, config.architecture, weights, squash=True)


def _tensors(pairs: StateActions, scaling: Scaling) -> tuple[Tensor, Tensor]:
    return (
        torch.from_numpy(scaling.normalize_observation(pairs.observations)),
        torch.from_numpy(scaling.normalize_action(pairs.actions)),
    )


def _batches(
    demonstrations: Demonstrations, scaling: Scaling, config: CloningConfig, generator: np.random.Generator
) -> Iterator[tuple[Tensor, Tensor]]:
    for start in range(0, config.steps, CHUNK):
        count = min(CHUNK, config.steps - start)
        observations, actions = _tensors(demonstrations.sample(count * config.batch_size, generator), scaling)
        yield from zip(observations.split(config.batch_size), actions.split(config.batch_size), strict=True)


@torch.no_grad()
def _validate(step: int, network: Perceptron, pairs: tuple[Tensor, Tensor], losses: list[Tensor]) -> CurvePoint:
    validation = float(_cloning_loss(network(pairs[0])[0] - pairs[1]))
    train = float(torch.stack(losses).mean())
    if not math.isfinite(train) or not math.isfinite(validation):
        raise RledError(f"the loss is no number at step {step}", "", "lower the learning rate or check the bag")
    return CurvePoint(step, train, validation)
