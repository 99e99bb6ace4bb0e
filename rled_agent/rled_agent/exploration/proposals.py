"""Proposals: actor and expert propose, the critics choose (IBRL, Hu et al., 2024)."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy, by_agent

Value = Callable[[Tensor, Tensor], Tensor]
"""Of normalised observations, (P, b, o), and actions, (P, b, n): (P, b, 1)."""


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

    def act(self, observation: Tensor) -> Choice:
        """The proposal of greater value."""
        own, demonstrated = self.noise.added_to(self.policy(observation)), self.expert(observation)
        both, rows = torch.stack((demonstrated, own), dim=1), observation[:, None].expand(-1, 2, -1)
        values = self.value(rows, both)[..., 0]  # (P, 2)
        by_expert = values[:, 0] > values[:, 1]
        action = torch.where(by_expert[:, None], demonstrated, own)
        return by_agent(action)._replace(by_expert=by_expert)
