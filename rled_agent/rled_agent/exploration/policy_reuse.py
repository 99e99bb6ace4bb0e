"""Biased exploration: a draw an episode says whether the expert drives all of it (Algorithm 2)."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from rled_msgs_py.records import GateCode
from torch import Tensor

from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy, is_anywhere
from rled_agent.nn.draws import Draws
from rled_agent.per_seed import column


@dataclass
class PolicyReuse(Strategy):
    """With probability Φ a whole episode is driven by the expert (Eq. 4.11, 4.12); Φ = 0 leaves the strategy alone.

    Attributes:
        strategy: acts in the other episodes.
        expert: π̂ᵈ.
        phi: Φ, the probability of policy reuse.
        draws: draws ξ.
        expert_episode: whether the expert was drawn, shape (P,).
    """

    strategy: Strategy
    expert: PolicyFunction
    phi: float
    draws: Draws

    def __post_init__(self) -> None:
        self.expert_episode = torch.zeros(self.draws.population, dtype=torch.bool, device=self.draws.device)
        self._is_drawn = is_anywhere(self.expert_episode)

    def begin(self, where: Tensor) -> None:
        """Draw ξ (Eq. 4.11)."""
        xi = self.draws.uniform()
        self.expert_episode = torch.where(where, xi < column(self.phi, xi), self.expert_episode)
        self._is_drawn = is_anywhere(self.expert_episode)
        self.strategy.begin(where)

    def act(self, observation: Tensor) -> Choice:
        """Act by Eq. 4.12."""
        choice, drawn = self.strategy.act(observation), self.expert_episode
        if not self._is_drawn:
            return choice
        action = torch.where(drawn[:, None], self.expert(observation), choice.action)
        code = torch.where(drawn, int(GateCode.DRAWN), choice.code)
        return choice._replace(action=action, by_expert=drawn | choice.by_expert, code=code)

    def end(self, where: Tensor, episode_return: Tensor) -> None:
        """Episodes have ended."""
        self.strategy.end(where, episode_return)

    def state_dict(self) -> dict[str, Tensor]:
        """Who drives these episodes, and the state of the strategy behind."""
        return {"expert_episode": self.expert_episode} | self.strategy.state_dict()

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Go on with the episodes."""
        self.expert_episode = state["expert_episode"].to(self.expert_episode)
        self._is_drawn = is_anywhere(self.expert_episode)
        self.strategy.load_state_dict(state)
