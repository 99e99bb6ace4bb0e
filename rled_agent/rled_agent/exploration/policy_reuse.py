"""Biased exploration: a draw an episode says whether the expert drives all of it (Algorithm 2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateCode

from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy
from rled_agent.uncertainty.uncertainty import Uncertainty


@dataclass
class PolicyReuse(Strategy):
    """With probability Φ a whole episode is driven by the expert (Eq. 4.11, 4.12); Φ = 0 leaves the strategy alone.

    Attributes:
        strategy: acts in the other episodes.
        expert: π̂ᵈ.
        phi: Φ, the probability of policy reuse.
        generator: draws ξ once an episode.
        uncertainty: estimates u_t for the record in the expert's episodes, None to leave it out.
        expert_episode: whether the expert was drawn.
    """

    strategy: Strategy
    expert: PolicyFunction
    phi: float
    generator: np.random.Generator
    uncertainty: Uncertainty | None = None
    expert_episode: bool = False

    def begin(self) -> None:
        """Draw ξ (Eq. 4.11)."""
        self.expert_episode = bool(self.generator.random() < self.phi)
        self.strategy.begin()

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Act by Eq. 4.12."""
        if not self.expert_episode:
            return self.strategy.act(observation)
        estimated = self.uncertainty(observation).uncertainty if self.uncertainty else {}
        return Choice(self.expert(observation), Actor.EXPERT, GateCode.DRAWN, estimated)

    def end(self, episode_return: float) -> None:
        """An episode has ended."""
        self.strategy.end(episode_return)

    def state_dict(self) -> dict[str, Any]:
        """Who drives this episode, and the state of the strategy behind."""
        return {"expert_episode": self.expert_episode, "strategy": self.strategy.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on with the episode."""
        self.expert_episode = state["expert_episode"]
        self.strategy.load_state_dict(state["strategy"])
