"""A strategy says who acts in a state; the same object serves training and the agent node."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateCode

from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import Policy
from rled_agent.nn.scaling import Scaling

Action = NDArray[np.float32]
PolicyFunction = Callable[[NDArray[np.float32]], Action]
"""A deterministic map of normalised observation, shape (o,), to normalised action, shape (n,)."""


class Choice(NamedTuple):
    """One action, whose it is, and why.

    Attributes:
        action: normalised, shape (n,).
        actor: AGENT or EXPERT.
        code: why that one acts.
        uncertainty: u_t by measure, empty where it is not estimated.
        measure: the one that was compared with the threshold; ``none`` where nothing was.
        threshold: ξ that it was compared with.
        note: what the code does not say, for people.
    """

    action: Action
    actor: Actor
    code: GateCode
    uncertainty: Mapping[str, float] = {}
    measure: str = "none"
    threshold: float = math.nan
    note: str = ""

    @property
    def compared(self) -> float:
        """u_t by the measure that was compared, NaN where none was."""
        return self.uncertainty.get(self.measure, math.nan)


class Strategy:
    """What drives an episode."""

    def begin(self) -> None:
        """An episode begins."""

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Choose an action for a normalised observation, shape (o,)."""
        raise NotImplementedError

    def end(self, episode_return: float) -> None:
        """An episode has ended, with that sum of rewards."""

    def state_dict(self) -> dict[str, Any]:
        """What a checkpoint keeps of it, plain JSON values."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``."""


def network_function(network: Perceptron) -> PolicyFunction:
    """A network's action without dropout."""

    @torch.inference_mode()
    def act(observation: NDArray[np.float32]) -> Action:
        action: Action = network(torch.from_numpy(observation)[None])[0, 0].cpu().numpy()
        return action

    return act


def policy_function(policy: Policy, scaling: Scaling) -> PolicyFunction:
    """A policy's action, for observations and actions normalised by another scaling than its own."""

    def act(observation: NDArray[np.float32]) -> Action:
        return scaling.normalize_action(policy.act(scaling.denormalize_observation(observation)))

    return act
