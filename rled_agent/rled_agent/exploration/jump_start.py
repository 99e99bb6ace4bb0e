"""Jump-start: the expert begins each episode, ever more briefly, and the actor goes on (JSRL, Uchendu et al., 2023)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Choice, PolicyFunction, Strategy, by_agent, is_anywhere

JUDGED_EPISODES = 5
"""Episodes whose mean return decides about a stage."""
LOWEST = torch.finfo(torch.float64).min
"""A checkpoint holds no infinity."""


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
        stage: under way, from 0, shape (P,).
        step: of the episode, shape (P,).
        best: mean return so far, the lowest number there is before the first, shape (P,).
        returns: of the last episodes, the latest first, shape (P, 5).
        episodes: that have ended in this stage, shape (P,).
    """

    policy: PolicyFunction
    expert: PolicyFunction
    noise: Noise
    guide_steps: int
    stages: int
    tolerance: float

    def __post_init__(self) -> None:
        seeds, device = self.noise.draws.population, self.noise.draws.device
        self.stage, self.step, self.episodes = (torch.zeros(seeds, dtype=torch.int64, device=device) for _ in range(3))
        self.best = torch.full((seeds,), LOWEST, dtype=torch.float64, device=device)
        self.returns = torch.zeros(seeds, JUDGED_EPISODES, dtype=torch.float64, device=device)

    def begin(self, where: Tensor) -> None:
        """Episodes begin."""
        self.step = torch.where(where, 0, self.step)

    def act(self, observation: Tensor) -> Choice:
        """Guide or actor, by the step of the episode."""
        guided = self.step < self.guide_steps * (1.0 - self.stage / self.stages)
        self.step = self.step + 1
        action = self.noise.added_to(self.policy(observation))
        if is_anywhere(guided):
            action = torch.where(guided[:, None], self.expert(observation), action)
        return by_agent(action)._replace(by_expert=guided)

    def end(self, where: Tensor, episode_return: Tensor) -> None:
        """Judge the last few episodes of this stage."""
        returns = torch.cat((episode_return.double()[:, None], self.returns[:, :-1]), dim=1)
        mean, episodes = returns.mean(dim=1), self.episodes + 1
        judged = where & (episodes >= JUDGED_EPISODES)
        best = torch.where(judged, torch.maximum(self.best, mean), self.best)
        passed = judged & (self.stage < self.stages) & (mean >= best - self.tolerance * best.abs())
        self.returns = torch.where(where[:, None], returns, self.returns)
        self.episodes = torch.where(where, torch.where(passed, 0, episodes), self.episodes)
        self.best, self.stage = best, self.stage + passed.long()

    def state_dict(self) -> dict[str, Tensor]:
        """What a checkpoint keeps."""
        names = ("stage", "step", "best", "returns", "episodes")
        return {name: getattr(self, name) for name in names}
