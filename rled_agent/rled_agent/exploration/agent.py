"""The policy alone, with exploration noise, and random first actions in front of it."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy, by_agent
from rled_agent.nn.draws import Draws
from rled_agent.per_seed import column
from rled_agent.uncertainty.uncertainty import Uncertainty


@dataclass(frozen=True)
class Noise:
    """ε ~ N(0, δ), added to a normalised action that is then clipped to [−1, 1].

    Attributes:
        std: δ, in halves of the action range.
        draws: draws it.
    """

    std: float
    draws: Draws

    def added_to(self, action: Tensor) -> Tensor:
        """The actions, shape (P, n), with noise."""
        if not isinstance(self.std, Tensor) and not self.std:
            self.draws.skip(action.shape[1])  # a seed beside it may have noise
            return action
        noise = self.draws.normal(action.shape[1]) * column(self.std, action)
        noisy: Tensor = (action + noise).clamp_(-1.0, 1.0)
        return noisy


@dataclass
class Agent(Strategy):
    """The learned policy always acts.

    Attributes:
        policy: π_θ.
        noise: ε.
        uncertainty: estimates u_t for the record, None to leave it out.
    """

    policy: PolicyFunction
    noise: Noise
    uncertainty: Uncertainty | None = None

    def act(self, observation: Tensor) -> Choice:
        """Its action with noise."""
        estimated = self.uncertainty(observation).uncertainty if self.uncertainty else {}
        return by_agent(self.noise.added_to(self.policy(observation)), estimated)


@dataclass
class Expert(Strategy):
    """The cloned expert always acts.

    Attributes:
        expert: π̂ᵈ.
    """

    expert: PolicyFunction

    def act(self, observation: Tensor) -> Choice:
        """Its action."""
        action = self.expert(observation)
        choice = by_agent(action)
        return choice._replace(by_expert=~choice.by_expert)


@dataclass
class RandomStart(Strategy):
    """Actions drawn uniformly for the first steps, as TD3 begins (Fujimoto et al., 2018, Algorithm 1 in practice).

    Attributes:
        strategy: acts after them.
        steps: how many.
        size: n.
        draws: draws them.
        taken: how many were drawn, of each seed, shape (P,).
    """

    strategy: Strategy
    steps: int
    size: int
    draws: Draws

    def __post_init__(self) -> None:
        self.taken = torch.zeros(self.draws.population, dtype=torch.int64)
        self._count = 0

    def begin(self, where: Tensor) -> None:
        """Episodes begin."""
        self.strategy.begin(where)

    def act(self, observation: Tensor) -> Choice:
        """Random actions, or what the strategy behind chooses."""
        if self._count >= self.steps:
            return self.strategy.act(observation)
        self._count += 1
        self.taken += 1
        return by_agent(self.draws.uniform(self.size) * 2.0 - 1.0)

    def end(self, where: Tensor, episode_return: Tensor) -> None:
        """Episodes have ended."""
        self.strategy.end(where, episode_return)

    def state_dict(self) -> dict[str, Tensor]:
        """How many actions were drawn, and the state of the strategy behind."""
        return {"taken": self.taken} | self.strategy.state_dict()

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Go on from ``state``."""
        self.taken.copy_(state["taken"])
        self._count = int(self.taken[0])
        self.strategy.load_state_dict(state)
