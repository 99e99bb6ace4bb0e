"""The policy alone, with exploration noise, and random first actions in front of it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateCode

from rled_agent.exploration.strategy import Action, Choice, PolicyFunction, Strategy
from rled_agent.uncertainty.uncertainty import Uncertainty


@dataclass(frozen=True)
class Noise:
    """ε ~ N(0, δ), added to a normalised action that is then clipped to [−1, 1].

    Attributes:
        std: δ, in halves of the action range.
        generator: draws it.
    """

    std: float
    generator: np.random.Generator

    def added_to(self, action: Action) -> Action:
        """The action with noise."""
        if not self.std:
            return action
        noise = self.generator.normal(0.0, self.std, action.shape)
        return np.clip(action + noise, -1.0, 1.0).astype(np.float32)


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

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Its action with noise."""
        estimated = self.uncertainty(observation).uncertainty if self.uncertainty else {}
        return Choice(self.noise.added_to(self.policy(observation)), Actor.AGENT, GateCode.UNGATED, estimated)


@dataclass
class Expert(Strategy):
    """The cloned expert always acts.

    Attributes:
        expert: π̂ᵈ.
    """

    expert: PolicyFunction

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Its action."""
        return Choice(self.expert(observation), Actor.EXPERT, GateCode.UNGATED)


@dataclass
class RandomStart(Strategy):
    """Actions drawn uniformly for the first steps, as TD3 begins (Fujimoto et al., 2018, Algorithm 1 in practice).

    Attributes:
        strategy: acts after them.
        steps: how many.
        size: n.
        generator: draws them.
        taken: how many were drawn.
    """

    strategy: Strategy
    steps: int
    size: int
    generator: np.random.Generator
    taken: int = 0

    def begin(self) -> None:
        """An episode begins."""
        self.strategy.begin()

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """A random action, or what the strategy behind chooses."""
        if self.taken >= self.steps:
            return self.strategy.act(observation)
        self.taken += 1
        action = self.generator.uniform(-1.0, 1.0, self.size).astype(np.float32)
        return Choice(action, Actor.AGENT, GateCode.UNGATED)

    def end(self, episode_return: float) -> None:
        """An episode has ended."""
        self.strategy.end(episode_return)

    def state_dict(self) -> dict[str, Any]:
        """How many actions were drawn, and the state of the strategy behind."""
        return {"taken": self.taken, "strategy": self.strategy.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        self.taken = state["taken"]
        self.strategy.load_state_dict(state["strategy"])
