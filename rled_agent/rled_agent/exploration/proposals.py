"""Proposals: actor and expert propose, the critics choose (IBRL, Hu et al., 2024)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateCode

from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Action, Choice, PolicyFunction, Strategy

Value = Callable[[NDArray[np.float32], Action], float]
"""Of a normalised observation and action."""


@dataclass
class Proposals(Strategy):
    """Actor and expert propose, the critics choose (IBRL, Hu et al., 2024).

    Attributes:
        policy: π_θ.
        expert: the policy that was cloned.
        noise: ε, on the actor's proposal.
        value: of an observation and an action, by the target critics.
    """

    policy: PolicyFunction
    expert: PolicyFunction
    noise: Noise
    value: Value

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """The proposal of greater value."""
        own, demonstrated = self.noise.added_to(self.policy(observation)), self.expert(observation)
        if self.value(observation, demonstrated) > self.value(observation, own):
            return Choice(demonstrated, Actor.EXPERT, GateCode.UNGATED)
        return Choice(own, Actor.AGENT, GateCode.UNGATED)
