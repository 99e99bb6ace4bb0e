"""What an actor is improved by: differentiable functions of its actions, their values and the transitions."""

from dataclasses import dataclass
from typing import Annotated, Protocol

import torch
from rled_msgs_py.validation import Range
from torch import Tensor

from rled_agent.nn.perceptron import Perceptron
from rled_agent.per_seed import PER_SEED, column
from rled_agent.replay.transitions import Transitions


class ActorLoss(Protocol):
    """A loss of an actor."""

    def __call__(self, action: Tensor, q: Tensor, transitions: Transitions, critic: Perceptron) -> Tensor:
        """Of each seed, shape (P,).

        Args:
            action: of the actor, shape (P, b, n).
            q: its value, shape (P, b, 1).
            transitions: whose observations they are of.
            critic: that gave the values; no gradient reaches its weights.
        """
        ...


def policy_gradient(action: Tensor, q: Tensor, transitions: Transitions, critic: Perceptron) -> Tensor:
    """−J_a, the deterministic policy gradient (Eq. 4.8)."""
    return -q.mean(dim=(1, 2))


@dataclass(frozen=True)
class Cloning:
    """Cloning beside the policy gradient, of what a batch holds of demonstrations and people (Nair et al., 2018).

    −J_a counts over the mean size of Q then, so that the weight means the same for any reward (Fujimoto and Gu, 2021).
    """

    weight: Annotated[float, Range(0, 1e6), PER_SEED] = 1.0
    """of the cloning error (Eq. 4.10); 0 leaves it out"""
    q_filter: bool = True
    """clone only where the critic holds the demonstrated action for the better one"""

    def loss(self) -> ActorLoss:
        """The loss of an actor with these settings."""
        return self._loss if isinstance(self.weight, Tensor) or self.weight else policy_gradient

    def _loss(self, action: Tensor, q: Tensor, transitions: Transitions, critic: Perceptron) -> Tensor:
        plain, size = policy_gradient(action, q, transitions, critic), q.detach().abs().mean(dim=(1, 2))  # (P,)
        improvement = plain / torch.where(size > 0.0, size, 1.0)
        demonstrated = transitions.demonstrated
        error = (action - transitions.action).square().sum(dim=2, keepdim=True)  # (P, b, 1)
        cloned = demonstrated
        if self.q_filter:
            shown = critic(torch.cat((transitions.observation, transitions.action), dim=2))
            cloned = demonstrated * (shown > q)
        mean_error = (error * cloned).sum(dim=(1, 2)) / demonstrated.sum(dim=(1, 2)).clamp(min=1.0)
        weight = column(self.weight, mean_error)
        loss = improvement + weight * mean_error
        return torch.where(weight > 0.0, loss, plain) if isinstance(weight, Tensor) else loss
