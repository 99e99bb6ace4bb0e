"""DDPG: one critic, each step changes everything; no demonstrations."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from rled_msgs_py.validation import Range

from rled_agent.exploration.strategy import Strategy
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic, agent_strategy
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.per_seed import PER_SEED


@dataclass(frozen=True)
class DDPG(Method):
    """Deep Deterministic Policy Gradient: TD3 with one critic, no delay and no noise on target actions."""

    title: ClassVar[str] = "actor-critic with one critic, without demonstrations"
    paper: ClassVar[str] = "Lillicrap et al., 2016; Algorithm 1"

    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    learner: TD3Config = field(default_factory=lambda: TD3Config(critics=1, delay=1, target_noise=0.0))
    """of the update"""

    def learning(self, problem: Problem) -> Learning:
        """DDPG on a uniform replay."""
        return actor_critic(problem, self.learner)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """The actor with noise."""
        return agent_strategy(problem, learner, self.noise)
