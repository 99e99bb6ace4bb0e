"""Jump-start: the expert begins each episode, ever more briefly, and the actor goes on (JSRL, Uchendu et al., 2023)."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor, GateCode

from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy

JUDGED_EPISODES = 5
"""Episodes whose mean return decides about a stage."""


@dataclass
class JumpStart(Strategy):
    """The expert begins each episode, in each stage more briefly, and the actor goes on (JSRL, Uchendu et al., 2023).

    As in its Algorithm 1, the next stage begins when both together do about as well as they have ever done.

    Attributes:
        policy: π_θ.
        expert: the guide policy.
        noise: ε.
        guide_steps: steps of an episode in which the guide acts, in the first stage.
        stages: after which it acts no more.
        tolerance: share of the best mean return that may lack for the next stage.
        stage: under way, from 0.
        step: of the episode.
        best: mean return so far.
        returns: of the episodes of this stage.
    """

    policy: PolicyFunction
    expert: PolicyFunction
    noise: Noise
    guide_steps: int
    stages: int
    tolerance: float
    stage: int = 0
    step: int = 0
    best: float = -math.inf
    returns: list[float] = field(default_factory=list)

    def begin(self) -> None:
        """An episode begins."""
        self.step = 0

    def act(self, observation: NDArray[np.float32]) -> Choice:
        """Guide or actor, by the step of the episode."""
        guided = self.step < self.guide_steps * (1.0 - self.stage / self.stages)
        self.step += 1
        if guided:
            return Choice(self.expert(observation), Actor.EXPERT, GateCode.UNGATED)
        return Choice(self.noise.added_to(self.policy(observation)), Actor.AGENT, GateCode.UNGATED)

    def end(self, episode_return: float) -> None:
        """Judge the last few episodes of this stage."""
        self.returns = [*self.returns[1 - JUDGED_EPISODES :], episode_return]
        if len(self.returns) < JUDGED_EPISODES:
            return
        mean = float(np.mean(self.returns))
        self.best = max(self.best, mean)
        if self.stage < self.stages and mean >= self.best - self.tolerance * abs(self.best):
            self.stage, self.returns = self.stage + 1, []

    def state_dict(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        best = self.best if self.best > -math.inf else None
        return {"stage": self.stage, "step": self.step, "best": best, "returns": self.returns}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        self.stage, self.step, self.returns = state["stage"], state["step"], state["returns"]
        self.best = -math.inf if state["best"] is None else state["best"]
