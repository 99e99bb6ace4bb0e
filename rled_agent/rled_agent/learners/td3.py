"""TD3 (Eq. 4.1-4.9; Fujimoto et al., 2018), of which DDPG (Algorithm 1) is a case."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.validation import Range, check_fields
from torch import Tensor

from rled_agent.bounds import Amount, Share
from rled_agent.learners.actor_losses import ActorLoss, policy_gradient
from rled_agent.learners.learner import Update
from rled_agent.nn.adam import Adam
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.perceptron import Perceptron
from rled_agent.replay.transitions import Transitions

BatchPolicy = Callable[[Tensor], Tensor]
"""Normalised actions, (b, n), for normalised observations, (b, o)."""


@dataclass(frozen=True)
class TD3Config:
    """Settings of the update."""

    gamma: Share = 0.99
    """discount γ"""
    reward_scale: Amount = 1.0
    """factor on rewards before they are learned from; critics of values near 1 settle soonest"""
    actor_rate: Share = 1e-3
    """learning rate α_a"""
    critic_rate: Share = 1e-3
    """learning rate α_c"""
    rate_decay: Amount = 0.0
    """β of α_k = α/(1 + k/β) in gradient steps k (Theorem 5); 0 keeps the rate constant"""
    tau: Share = 5e-3
    """soft update τ"""
    critics: Annotated[int, Range(1, 100)] = 2
    """the target is the lesser value of two critics (TD3), or of so many; 1 for DDPG"""
    delay: Annotated[int, Range(1, 1000)] = 2
    """gradient steps of the critics for one of the actor and the targets (TD3); 1 for DDPG"""
    target_noise: Annotated[float, Range(0, 10)] = 0.2
    """σ of the smoothing noise on target actions (TD3); 0 for DDPG"""
    target_clip: Annotated[float, Range(0, 10)] = 0.5
    """c, bound of that noise"""
    target_dropout: bool = False
    """the target actor drops units too"""
    actor: Architecture = field(default_factory=Architecture)
    """hidden part of the actor"""
    critic: Architecture = field(default_factory=Architecture)
    """hidden part of each critic"""

    def __post_init__(self) -> None:
        check_fields(self, "learner.")
        if self.critic.dropout:
            raise ContractError(f"learner.critic.dropout is {self.critic.dropout}", "0", "critics drop no units")


class TD3Learner:
    """Actor, critics, their targets and the update; all tensors are on the generator's device.

    Args:
        observation_size: o.
        action_size: n.
        config: settings.
        generator: draws weights, target noise and dropped units.
        actor_loss: what the actor is improved by.
        proposal: another policy; the target takes its action where the target critics prefer it (IBRL).
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        config: TD3Config,
        generator: torch.Generator,
        actor_loss: ActorLoss = policy_gradient,
        proposal: BatchPolicy | None = None,
    ) -> None:
        self.config, self.generator = config, generator
        self._actor_loss, self._proposal = actor_loss, proposal
        self.updates = 0
        inputs = observation_size + action_size
        self.actor = Perceptron(observation_size, action_size, config.actor, generator, squash=True)
        self.critic = Perceptron(inputs, 1, config.critic, generator, members=config.critics)
        self.target_actor, self.target_critic = self.actor.frozen(), self.critic.frozen()
        self._first_critic = self.critic.first()
        pairs = ((self.target_critic, self.critic), (self.target_actor, self.actor))
        self._targets: list[Tensor] = [each for target, _ in pairs for each in target.parameters()]
        self._followed: list[Tensor] = [each for _, network in pairs for each in network.parameters()]
        self._actor_adam = Adam(self.actor)
        self._critic_adam = Adam(self.critic)

    def start_from(self, actor: Perceptron) -> None:
        """Begin with the weights of a policy that is there already; the target follows from there."""
        for network in (self.actor, self.target_actor):
            network.load_state_dict(actor.state_dict())

    def update(self, transitions: Transitions) -> Update:
        """One gradient step of the critics and, every ``delay`` of them, of actor and targets."""
        target = self._target(transitions)
        q = self.critic(torch.cat((transitions.observation, transitions.action), dim=1))  # (e, b, 1)
        error = q - target
        squared = error.square()
        loss = (squared * transitions.weight).sum() / len(target)  # Eq. 4.5, summed over the critics
        self._critic_adam.step(loss, self._rate(self.config.critic_rate))  # Eq. 4.6
        if (self.updates + 1) % self.config.delay == 0:
            self._actor_adam.step(self._improvement(transitions), self._rate(self.config.actor_rate))  # Eq. 4.8
            self._update_targets()
        self.updates += 1
        return Update(error.detach().mean(dim=0)[:, 0], {"critic_loss": squared.detach(), "q": q.detach()})

    @torch.no_grad()
    def _target(self, transitions: Transitions) -> Tensor:
        """Y = r + γ (1 − terminated) min_i Q'_i(s', ã) (Eq. 4.4), shape (b, 1)."""
        config, following = self.config, transitions.next_observation
        action = self.target_actor(following, self.generator if config.target_dropout else None)[0]  # (b, n)
        if config.target_noise:
            noise = torch.empty_like(action).normal_(0.0, config.target_noise, generator=self.generator)
            action = (action + noise.clamp_(-config.target_clip, config.target_clip)).clamp_(-1.0, 1.0)
        q = self._target_value(following, action)
        if self._proposal is not None:
            q = torch.maximum(q, self._target_value(following, self._proposal(following)))
        return transitions.reward * config.reward_scale + transitions.discount * q

    def _target_value(self, observation: Tensor, action: Tensor) -> Tensor:
        """The lesser value of the target critics, shape (b, 1)."""
        value: Tensor = self.target_critic(torch.cat((observation, action), dim=1)).amin(dim=0)
        return value

    def _improvement(self, transitions: Transitions) -> Tensor:
        """What the actor is changed against: −J_a, or the loss that stands for it."""
        action = self.actor(transitions.observation, self.generator)[0]  # (b, n)
        q: Tensor = self._first_critic(torch.cat((transitions.observation, action), dim=1))[0]  # (b, 1)
        return self._actor_loss(action, q, transitions, self._first_critic)

    @torch.no_grad()
    def _update_targets(self) -> None:
        torch._foreach_lerp_(self._targets, self._followed, self.config.tau)  # Eq. 4.7, 4.9

    @torch.no_grad()
    def value(self, observation: NDArray[np.float32], action: NDArray[np.float32]) -> float:
        """The lesser value of the target critics of one observation, shape (o,), and action, shape (n,)."""
        return float(self._target_value(torch.from_numpy(observation)[None], torch.from_numpy(action)[None]))

    def networks(self) -> dict[str, Perceptron]:
        """Networks by name."""
        return {
            "actor": self.actor,
            "critic": self.critic,
            "target_actor": self.target_actor,
            "target_critic": self.target_critic,
        }

    def state_dict(self) -> dict[str, Any]:
        """All state but the generator: tensors by dotted name, which share memory, and ``updates``."""
        state: dict[str, Any] = {
            f"{name}.{part}": tensor.detach()
            for name, network in self.networks().items()
            for part, tensor in network.named_parameters()
        }
        for name, optimizer in (("actor_adam", self._actor_adam), ("critic_adam", self._critic_adam)):
            state |= {f"{name}.{part}": tensor for part, tensor in optimizer.tensors().items()}
        return state | {"updates": self.updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is of other networks.
        """
        own = {name: tensor for name, tensor in self.state_dict().items() if isinstance(tensor, Tensor)}
        for name, tensor in own.items():
            if name not in state or state[name].shape != tensor.shape:
                found = tuple(state[name].shape) if name in state else "nothing"
                raise RledError(f"it holds {found} as {name}", str(tuple(tensor.shape)))
        for name, tensor in own.items():
            tensor.copy_(state[name])
        self.updates = state["updates"]

    def _rate(self, rate: float) -> float:
        decay = self.config.rate_decay
        return rate / (1.0 + self.updates / decay) if decay else rate
