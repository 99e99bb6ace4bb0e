"""Preloading: the replay begins full of demonstrations."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from rled_msgs_py.validation import Range

from rled_agent.bounds import MAX_TRANSITIONS
from rled_agent.exploration.strategy import Strategy
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic, agent_strategy
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.per_seed import PER_SEED


@dataclass(frozen=True)
class Preloading(Method):
    """TD3 whose replay holds demonstrated transitions before the first step; nothing else is done with them."""

    title: ClassVar[str] = "the replay begins with demonstrations"
    paper: ClassVar[str] = "Vecerik et al., 2017, without priorities and n-step returns"
    needs: ClassVar[tuple[str, ...]] = ("demonstrations",)

    preload: Annotated[int, Range(0, MAX_TRANSITIONS)] = 50_000
    """demonstrated transitions put into the replay before the first step"""
    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    learner: TD3Config = field(default_factory=lambda: TD3Config(gamma=0.9, reward_scale=1e-3))
    """of the update"""

    def learning(self, problem: Problem) -> Learning:
        """TD3 on a replay that begins with demonstrations."""
        return actor_critic(problem, self.learner, preload=self.preload)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """The actor with noise."""
        return agent_strategy(problem, learner, self.noise)
