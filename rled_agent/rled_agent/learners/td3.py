"""DDPG (Algorithm 1) and TD3 (Eq. 4.1-4.9) as one update with options."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.validation import Range
from torch import Tensor

from rled_agent.bounds import Amount, Share
from rled_agent.nn.adam import adam, state_of, step
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.perceptron import Perceptron
from rled_agent.replay import Batch

Expert = Callable[[NDArray[np.float32]], NDArray[np.float32]]


@dataclass(frozen=True)
class LearnerConfig:
    """Settings of the update.

    Attributes:
        gamma: discount γ.
        reward_scale: factor on rewards before they are learned from; critics of values near 1 settle soonest.
        actor_rate: learning rate α_a.
        critic_rate: learning rate α_c.
        rate_decay: β of α_k = α/(1 + k/β) in gradient steps k (Theorem 5); 0 keeps the rate constant.
        tau: soft update τ.
        critics: 2 takes the lesser of two critics (TD3), 1 the only one (DDPG).
        delay: gradient steps of the critics for one of the actor and the targets (TD3); 1 for DDPG.
        target_noise: σ of the smoothing noise on target actions (TD3); 0 for DDPG.
        target_clip: c, bound of that noise.
        target_dropout: the target actor drops units too.
        cloning_weight: weight of the cloning error on a batch's demonstrated rows, beside Q over its mean size.
        expert_bootstrap: the target takes the expert's action where the target critics prefer it (IBRL).
        q_filter: clone only where the critic holds the demonstrated action for the better one (Nair et al., 2018).
        actor: hidden part of the actor.
        critic: hidden part of each critic.
    """

    gamma: Share = 0.99
    reward_scale: Amount = 1.0
    actor_rate: Share = 1e-3
    critic_rate: Share = 1e-3
    rate_decay: Amount = 0.0
    tau: Share = 5e-3
    critics: Annotated[int, Range(1, 2)] = 2
    delay: Annotated[int, Range(1, 1000)] = 2
    target_noise: Annotated[float, Range(0, 10)] = 0.2
    target_clip: Annotated[float, Range(0, 10)] = 0.5
    target_dropout: bool = False
    cloning_weight: Annotated[float, Range(0, 1e6)] = 0.0
    q_filter: bool = True
    expert_bootstrap: bool = False
    actor: Architecture = field(default_factory=Architecture)
    critic: Architecture = field(default_factory=Architecture)


class Metrics(NamedTuple):
    """What an update reports; it costs nothing until it is read.

    Attributes:
        error: Q_i − y, shape (e, b, 1).
        target: y, shape (b, 1).
    """

    error: Tensor
    target: Tensor

    @property
    def critic_loss(self) -> float:
        """Mean over the critics of J_c (Eq. 4.5)."""
        return float(self.error.square().mean())

    @property
    def q(self) -> float:
        """Mean value of the batch."""
        return float(self.error.mean() + self.target.mean())


class Learner:
    """Actor, critics, their targets and the update.

    Args:
        observation_size: o.
        action_size: n.
        config: settings.
        generator: draws weights, target noise and dropped units.
        expert: normalised actions (b, n) for normalised observations (b, o), for ``expert_bootstrap``.
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        config: LearnerConfig,
        generator: torch.Generator,
        expert: Expert | None = None,
    ) -> None:
        self.config, self.generator, self._expert = config, generator, expert
        self.updates = 0
        inputs = observation_size + action_size
        self.actor = Perceptron(observation_size, action_size, config.actor, generator, squash=True)
        self.critic = Perceptron(inputs, 1, config.critic, generator, members=config.critics)
        self.target_actor, self.target_critic = self.actor.frozen(), self.critic.frozen()
        self._first_critic = self.critic.first()
        self._actor_adam = adam(self.actor, config.actor_rate)
        self._critic_adam = adam(self.critic, config.critic_rate)

    def update(self, batch: Batch) -> Metrics:
        """One gradient step of the critics and, every ``delay`` of them, of actor and targets."""
        target = self._target(batch)
        error = self.critic(batch.pair) - target  # (e, b, 1)
        loss = error.square().sum() / len(batch)  # Eq. 4.5, summed over the critics
        step(self._critic_adam, loss, self._rate(self.config.critic_rate))  # Eq. 4.6
        if (self.updates + 1) % self.config.delay == 0:
            step(self._actor_adam, self._actor_loss(batch), self._rate(self.config.actor_rate))  # Eq. 4.8
            self._update_targets()
        self.updates += 1
        return Metrics(error.detach(), target)

    @torch.no_grad()
    def _target(self, batch: Batch) -> Tensor:
        """Y = r + γ (1 − terminated) min_i Q'_i(s', ã) (Eq. 4.4), shape (b, 1)."""
        config, following = self.config, batch.next_observation
        action = self.target_actor(following, self.generator if config.target_dropout else None)[0]  # (b, n)
        if config.target_noise:
            noise = torch.empty_like(action).normal_(0.0, config.target_noise, generator=self.generator)
            action = (action + noise.clamp_(-config.target_clip, config.target_clip)).clamp_(-1.0, 1.0)
        q = self._target_value(following, action)
        if config.expert_bootstrap and self._expert is not None:
            q = torch.maximum(q, self._target_value(following, torch.from_numpy(self._expert(following.numpy()))))
        return batch.reward * config.reward_scale + config.gamma * (1.0 - batch.terminated) * q

    def _target_value(self, observation: Tensor, action: Tensor) -> Tensor:
        """The lesser value of the target critics, shape (b, 1)."""
        value: Tensor = self.target_critic(torch.cat((observation, action), dim=1)).amin(dim=0)
        return value

    def _actor_loss(self, batch: Batch) -> Tensor:
        """−J_a, with the cloning error on the demonstrated rows beside Q over its mean size."""
        weight = self.config.cloning_weight
        action = self.actor(batch.observation, self.generator)[0]  # (b, n)
        q: Tensor = self._first_critic(torch.cat((batch.observation, action), dim=1))[0]  # (b, 1)
        if not weight:
            return -q.mean()
        size = q.detach().abs().mean()
        loss = -q.mean() / torch.where(size > 0.0, size, 1.0)
        if batch.demonstrated:
            loss = loss + weight * self._cloning_loss(batch, action, q)
        return loss

    def _cloning_loss(self, batch: Batch, action: Tensor, q: Tensor) -> Tensor:
        """The cloning error (Eq. 4.10) of the actor's actions on the demonstrated rows."""
        rows = slice(len(batch) - batch.demonstrated, len(batch))
        error: Tensor = (action[rows] - batch.action[rows]).square().sum(dim=1, keepdim=True)  # (d, 1)
        if self.config.q_filter:
            error = error * (self._first_critic(batch.pair[rows])[0] > q[rows])
        return error.mean()

    @torch.no_grad()
    def _update_targets(self) -> None:
        for target, network in ((self.target_critic, self.critic), (self.target_actor, self.actor)):  # Eq. 4.7, 4.9
            torch._foreach_lerp_([*target.parameters()], [*network.parameters()], self.config.tau)

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

    def tensors(self) -> dict[str, Tensor]:
        """All state but ``updates`` and the generator, by dotted name, sharing memory."""
        state = {
            f"{name}.{part}": tensor.detach()
            for name, network in self.networks().items()
            for part, tensor in network.named_parameters()
        }
        for name, optimizer, network in (
            ("actor_adam", self._actor_adam, self.actor),
            ("critic_adam", self._critic_adam, self.critic),
        ):
            state |= {f"{name}.{part}": tensor for part, tensor in state_of(optimizer, network).items()}
        return state

    def _rate(self, rate: float) -> float:
        decay = self.config.rate_decay
        return rate / (1.0 + self.updates / decay) if decay else rate
