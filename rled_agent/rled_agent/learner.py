"""DDPG (Algorithm 1) and TD3 (Eq. 4.1-4.9) as one update with options."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.kinds import Range
from torch import Tensor

from rled_agent.adam import Adam
from rled_agent.architecture import Architecture
from rled_agent.bounds import Amount, Share
from rled_agent.memory import Rows
from rled_agent.networks import Network
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

    error: NDArray[np.floating]
    target: NDArray[np.floating]

    @property
    def critic_loss(self) -> float:
        """Mean over the critics of J_c (Eq. 4.5)."""
        return float(np.square(self.error).mean())

    @property
    def q(self) -> float:
        """Mean value of the batch."""
        return float(self.error.mean() + self.target.mean())


class Inputs:
    """What the networks read in an update: an actor the head of the rows that a critic reads.

    Args:
        count: b.
        observation_size: o.
        action_size: n.

    Attributes:
        critic: rows (s, a).
        actor: rows (s).
        action: a, shape (1, b, n): an actor writes where a critic reads.
        noise: memory for the smoothing noise, (1, b, n).
    """

    def __init__(self, count: int, observation_size: int, action_size: int) -> None:
        self.critic = Rows.empty(1, count, observation_size + action_size)
        self.actor = self.critic.head(observation_size)
        self.action = self.critic.units[..., observation_size:]
        self.noise = torch.empty(1, count, action_size)


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
        self._sizes = observation_size, action_size
        self._memory: dict[int, tuple[Inputs, Inputs]] = {}
        self._no_graph = torch.inference_mode()
        inputs = observation_size + action_size
        self.actor = Network(observation_size, action_size, config.actor, generator, squash=True)
        self.critic = Network(inputs, 1, config.critic, generator, members=config.critics)
        self.target_actor, self.target_critic = self.actor.copy(), self.critic.copy()
        self._first_critic = self.critic.first()
        self.actor_adam = Adam(self.actor.parameters, self.actor.gradients)
        self.critic_adam = Adam(self.critic.parameters, self.critic.gradients)

    def update(self, batch: Batch) -> Metrics:
        """One gradient step of the critics and, every ``delay`` of them, of actor and targets."""
        before, after = self._inputs(len(batch))
        with self._no_graph:
            before.critic.units.copy_(batch.pair)
            after.actor.units.copy_(batch.next_observation)
            metrics = self._update_critic(self._target(batch, after), before)
            if (self.updates + 1) % self.config.delay == 0:
                self._update_actor(batch, before)
                self._update_targets()
        self.updates += 1
        return metrics

    def _inputs(self, count: int) -> tuple[Inputs, Inputs]:
        if count not in self._memory:
            self._memory[count] = Inputs(count, *self._sizes), Inputs(count, *self._sizes)
        return self._memory[count]

    def _update_critic(self, target: NDArray[np.floating], before: Inputs) -> Metrics:
        error = self.critic.forward(before.critic).numpy() - target  # (e, b, 1)
        self.critic.backward(torch.from_numpy(error * (2.0 / len(target))))  # Eq. 4.5
        self.critic_adam.step(self._rate(self.config.critic_rate))  # Eq. 4.6
        return Metrics(error, target)

    def _target(self, batch: Batch, after: Inputs) -> NDArray[np.floating]:
        """Y = r + γ (1 − terminated) min_i Q'_i(s', ã) (Eq. 4.4), shape (b, 1)."""
        config = self.config
        self.target_actor.forward(after.actor, self.generator if config.target_dropout else None, after.action)
        if config.target_noise:
            noise = after.noise.normal_(0.0, config.target_noise, generator=self.generator)
            after.action.add_(noise.clamp_(-config.target_clip, config.target_clip)).clamp_(-1.0, 1.0)
        q = self.target_critic.forward(after.critic).amin(dim=0)  # (b, 1)
        if config.expert_bootstrap and self._expert is not None:
            after.action[0].copy_(torch.from_numpy(self._expert(batch.next_observation.numpy())))
            q = torch.maximum(q, self.target_critic.forward(after.critic).amin(dim=0))
        reward = batch.reward * config.reward_scale
        return torch.add(reward, q, alpha=config.gamma).lerp_(reward, batch.terminated).numpy()

    def _update_actor(self, batch: Batch, before: Inputs) -> None:
        self.actor.forward(before.actor, self.generator, before.action)
        q = self._first_critic.forward(before.critic)[0]  # (b, 1)
        size = float(q.abs().mean()) if self.config.cloning_weight else 1.0
        ascent = -1.0 / (len(batch) * (size or 1.0))  # gradient of −J_a at each Q
        at_action = self._first_critic.backward(ascent, parameters=False, inputs_from=batch.observation_size)
        assert at_action is not None  # (1, b, n)
        if self.config.cloning_weight and batch.demonstrated:
            at_action[0, -batch.demonstrated :] += self._cloning_gradient(batch, before.action[0], q.clone())
        self.actor.backward(at_action)
        self.actor_adam.step(self._rate(self.config.actor_rate))  # Eq. 4.8

    def _cloning_gradient(self, batch: Batch, action: Tensor, q: Tensor) -> Tensor:
        """Gradient of the cloning error (Eq. 4.10) at the actor's actions on the demonstrated rows, shape (d, n)."""
        rows = slice(len(batch) - batch.demonstrated, len(batch))
        error = action[rows] - batch.action[rows]
        if self.config.q_filter:
            better = self._first_critic.forward(batch.pair[rows])[0] > q[rows]
            error = error * better
        return error.mul_(2.0 * self.config.cloning_weight / batch.demonstrated)

    def _update_targets(self) -> None:
        self.target_critic.parameters.lerp_(self.critic.parameters, self.config.tau)  # Eq. 4.7
        self.target_actor.parameters.lerp_(self.actor.parameters, self.config.tau)  # Eq. 4.9

    def value(self, observation: NDArray[np.float32], action: NDArray[np.float32]) -> float:
        """The lesser value of the target critics of one observation, shape (o,), and action, shape (n,)."""
        pair = torch.from_numpy(np.concatenate([observation, action]))[None]
        return float(self.target_critic.forward(pair).amin())

    def networks(self) -> dict[str, Network]:
        """Networks by name."""
        return {
            "actor": self.actor,
            "critic": self.critic,
            "target_actor": self.target_actor,
            "target_critic": self.target_critic,
        }

    def tensors(self) -> dict[str, Tensor]:
        """All state but ``updates`` and the generator, by dotted name, sharing memory."""
        state = {f"{name}.parameters": network.parameters for name, network in self.networks().items()}
        for name, adam in (("actor_adam", self.actor_adam), ("critic_adam", self.critic_adam)):
            state |= {f"{name}.{part}": tensor for part, tensor in adam.tensors().items()}
        return state

    def _rate(self, rate: float) -> float:
        decay = self.config.rate_decay
        return rate / (1.0 + self.updates / decay) if decay else rate
