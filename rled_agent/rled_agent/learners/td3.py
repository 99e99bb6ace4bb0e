"""TD3 (Eq. 4.1-4.9; Fujimoto et al., 2018), of which DDPG (Algorithm 1) is a case."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import groupby
from typing import Annotated, Any

import torch
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.validation import Range, check_fields
from torch import Tensor

from rled_agent.bounds import Amount, Share
from rled_agent.learners.actor_losses import ActorLoss, policy_gradient
from rled_agent.learners.learner import Update
from rled_agent.nn.adam import Adam
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.per_seed import PER_SEED, column, of_seed
from rled_agent.replay.transitions import Transitions

BatchPolicy = Callable[[Tensor], Tensor]
"""Normalised actions of each seed, (P, b, n), for normalised observations, (P, b, o)."""
Rates = tuple[float, float, float]
"""α_a, α_c and β of a seed."""


@dataclass(frozen=True)
class TD3Config:
    """Settings of the update."""

    gamma: Annotated[Share, PER_SEED] = 0.99
    """discount γ"""
    reward_scale: Annotated[Amount, PER_SEED] = 1.0
    """factor on rewards before they are learned from; critics of values near 1 settle soonest"""
    actor_rate: Annotated[Share, PER_SEED] = 1e-3
    """learning rate α_a"""
    critic_rate: Annotated[Share, PER_SEED] = 1e-3
    """learning rate α_c"""
    rate_decay: Annotated[Amount, PER_SEED] = 0.0
    """β of α_k = α/(1 + k/β) in gradient steps k (Theorem 5); 0 keeps the rate constant"""
    tau: Annotated[Share, PER_SEED] = 5e-3
    """soft update τ"""
    critics: Annotated[int, Range(1, 100)] = 2
    """the target is the lesser value of two critics (TD3), or of so many; 1 for DDPG"""
    delay: Annotated[int, Range(1, 1000)] = 2
    """gradient steps of the critics for one of the actor and the targets (TD3); 1 for DDPG"""
    target_noise: Annotated[float, Range(0, 10), PER_SEED] = 0.2
    """σ of the smoothing noise on target actions (TD3); 0 for DDPG"""
    target_clip: Annotated[float, Range(0, 10), PER_SEED] = 0.5
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
    """Actor, critics, their targets and the update of P seeds; all tensors are on the device of the draws.

    No seed's numbers reach another's: a loss is the sum of what each has of its own.

    Args:
        observation_size: o.
        action_size: n.
        config: settings.
        draws: draws weights, target noise and dropped units.
        actor_loss: what the actor is improved by.
        proposal: another policy; the target takes its action where the target critics prefer it (IBRL).
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        config: TD3Config,
        draws: Draws,
        actor_loss: ActorLoss = policy_gradient,
        proposal: BatchPolicy | None = None,
    ) -> None:
        self.config, self.draws = config, draws
        self._actor_loss, self._proposal = actor_loss, proposal
        self.updates = 0
        inputs = observation_size + action_size
        self.actor = Perceptron(observation_size, action_size, config.actor, draws, squash=True)
        self.critic = Perceptron(inputs, 1, config.critic, draws, ensemble=config.critics)
        self.target_actor, self.target_critic = self.actor.frozen(), self.critic.frozen()
        self._first_critic = self.critic.first()
        groups = [(rates, len([*seeds])) for rates, seeds in groupby(map(self._rates_of, range(draws.population)))]
        self._rates, seeds = [rates for rates, _ in groups], [count for _, count in groups]
        self._actor_adam = Adam(self.actor, seeds)
        self._critic_adam = Adam(self.critic, seeds)
        self._followers = (
            _Follower(self.target_critic, self.critic, config.tau), _Follower(self.target_actor, self.actor, config.tau)
        )  # fmt: skip

    def _rates_of(self, seed: int) -> Rates:
        config = self.config
        return (
            of_seed(config.actor_rate, seed), of_seed(config.critic_rate, seed), of_seed(config.rate_decay, seed)
        )  # fmt: skip

    def start_from(self, actor: Perceptron) -> None:
        """Begin with the weights of a policy that is there already; the target follows from there."""
        for network in (self.actor, self.target_actor):
            network.load_state_dict(actor.state_dict())

    def update(self, transitions: Transitions) -> Update:
        """One gradient step of the critics and, every ``delay`` of them, of actor and targets."""
        target = self._target(transitions)
        q = self._ensemble(self.critic(torch.cat((transitions.observation, transitions.action), dim=2)))
        error = q - target[:, None]  # (P, e, b, 1)
        squared = error.square()
        loss = (squared * transitions.weight[:, None]).sum() / target.shape[1]  # Eq. 4.5, summed over the critics
        self._critic_adam.step(loss, [self._decayed(critic, decay) for _, critic, decay in self._rates])  # Eq. 4.6
        if (self.updates + 1) % self.config.delay == 0:
            rates = [self._decayed(actor, decay) for actor, _, decay in self._rates]
            self._actor_adam.step(self._improvement(transitions).sum(), rates)  # Eq. 4.8
            for each in self._followers:
                each.follow()
        self.updates += 1
        return Update(error.detach().mean(dim=1)[..., 0], {"critic_loss": squared.detach(), "q": q.detach()})

    def _ensemble(self, q: Tensor) -> Tensor:
        """Values of the critics of each seed, (P e, b, 1) as (P, e, b, 1)."""
        return q.view(self.draws.population, -1, *q.shape[1:])

    @torch.no_grad()
    def _target(self, transitions: Transitions) -> Tensor:
        """Y = r + γ (1 − terminated) min_i Q'_i(s', ã) (Eq. 4.4), shape (P, b, 1)."""
        config, following = self.config, transitions.next_observation
        action = self.target_actor(following, self.draws if config.target_dropout else None)  # (P, b, n)
        if isinstance(config.target_noise, Tensor) or config.target_noise:
            noise = self.draws.normal(*action.shape[1:]).to(action) * column(config.target_noise, action)
            clip = column(config.target_clip, action)
            action = (action + noise.clamp(-clip, clip)).clamp_(-1.0, 1.0)
        else:
            self.draws.skip(*action.shape[1:])  # a seed beside it may have noise
        q = self.value(following, action)
        if self._proposal is not None:
            q = torch.maximum(q, self.value(following, self._proposal(following)))
        target: Tensor = transitions.reward * column(config.reward_scale, q) + transitions.discount * q
        return target

    @torch.no_grad()
    def value(self, observation: Tensor, action: Tensor) -> Tensor:
        """The lesser value of the target critics, (P, b, 1), of observations, (P, b, o), and actions, (P, b, n)."""
        value: Tensor = self._ensemble(self.target_critic(torch.cat((observation, action), dim=2))).amin(dim=1)
        return value

    def _improvement(self, transitions: Transitions) -> Tensor:
        """What each actor is changed against, (P,): −J_a, or the loss that stands for it."""
        action = self.actor(transitions.observation, self.draws)  # (P, b, n)
        q: Tensor = self._first_critic(torch.cat((transitions.observation, action), dim=2))  # (P, b, 1)
        return self._actor_loss(action, q, transitions, self._first_critic)

    def networks(self) -> dict[str, Perceptron]:
        """Networks by name."""
        return {
            "actor": self.actor,
            "critic": self.critic,
            "target_actor": self.target_actor,
            "target_critic": self.target_critic,
        }

    def state_dict(self) -> dict[str, Any]:
        """All state but the draws: tensors by dotted name, which share memory, and counts of steps."""
        state: dict[str, Any] = {
            f"{name}.{part}": tensor.detach()
            for name, network in self.networks().items()
            for part, tensor in network.named_parameters()
        }
        for name, optimizer in (("actor_adam", self._actor_adam), ("critic_adam", self._critic_adam)):
            state |= {f"{name}.{part}": tensor for part, tensor in optimizer.tensors().items()}
        return state | {"updates": self.updates, "actor_updates": self._actor_adam.steps}

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
        self.updates = self._critic_adam.steps = state["updates"]
        self._actor_adam.steps = state["actor_updates"]

    def _decayed(self, rate: float, decay: float) -> float:
        return rate / (1.0 + self.updates / decay) if decay else rate


class _Follower:
    """A target network that follows another by τ (Eq. 4.7, 4.9)."""

    def __init__(self, target: Perceptron, network: Perceptron, tau: float) -> None:
        self._targets: list[Tensor] = [*target.parameters()]
        self._followed: list[Tensor] = [*network.parameters()]
        self._tau = tau.repeat_interleave(network.ensemble) if isinstance(tau, Tensor) else tau

    @torch.no_grad()
    def follow(self) -> None:
        if not isinstance(self._tau, Tensor):
            torch._foreach_lerp_(self._targets, self._followed, self._tau)
            return
        for target, followed in zip(self._targets, self._followed, strict=True):
            target.lerp_(followed, column(self._tau, target))
