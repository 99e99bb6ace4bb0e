"""Who acts while learning, in methods that the thesis's are compared with: JSRL and IBRL."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor

from rled_agent.behaviour import Action, Choice, Noise, Source

Value = Callable[[NDArray[np.float32], Action], float]
"""Of a normalised observation and action."""


@dataclass
class JumpStart:
    """The expert acts at the beginning of an episode, ever more briefly, then the actor (JSRL, Uchendu et al., 2023).

    Attributes:
        policy: π_θ.
        expert: the guide policy.
        noise: ε.
        guide_steps: steps of an episode in which the guide acts, at first.
        guide_until: environment steps after which it acts no more; in between its steps fall linearly.
        acted: environment steps so far.
        step: of the episode.
    """

    policy: Source
    expert: Source
    noise: Noise
    guide_steps: int
    guide_until: int
    acted: int = 0
    step: int = 0

    def begin(self) -> None:
        """An episode begins."""
        self.step = 0

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Guide or actor, by the step of the episode."""
        horizon = self.guide_steps * max(0.0, 1.0 - self.acted / self.guide_until)
        guided = self.step < horizon
        self.acted, self.step = self.acted + 1, self.step + 1
        if guided:
            return Choice(self.expert(observation), Actor.EXPERT, {})
        return Choice(self.noise.added_to(self.policy(observation)), Actor.AGENT, {})

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"acted": self.acted, "step": self.step}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        self.acted, self.step = state["acted"], state["step"]


@dataclass
class Proposal:
    """Actor and expert propose, the critics choose (IBRL, Hu et al., 2024).

    Attributes:
        policy: π_θ.
        expert: the policy that was cloned.
        noise: ε, on the actor's proposal.
        value: of an observation and an action, by the target critics.
    """

    policy: Source
    expert: Source
    noise: Noise
    value: Value

    def begin(self) -> None:
        """Nothing lasts an episode here."""

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """The proposal of greater value."""
        own, demonstrated = self.noise.added_to(self.policy(observation)), self.expert(observation)
        if self.value(observation, demonstrated) > self.value(observation, own):
            return Choice(demonstrated, Actor.EXPERT, {})
        return Choice(own, Actor.AGENT, {})

    def state(self) -> dict[str, Any]:
        """Nothing to keep."""
        return {}

    def restore(self, state: dict[str, Any]) -> None:
        """Nothing to go on from."""
