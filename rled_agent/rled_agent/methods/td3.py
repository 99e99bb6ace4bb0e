"""TD3: two critics, delayed and smoothed updates; no demonstrations."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from rled_msgs_py.validation import Range

from rled_agent.bounds import MANY
from rled_agent.exploration.agent import RandomStart
from rled_agent.exploration.strategy import Strategy
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic, agent_strategy
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.per_seed import PER_SEED


@dataclass(frozen=True)
class TD3(Method):
    """Twin Delayed DDPG. The target is the lesser value of two critics; actor and targets change every other step."""

    title: ClassVar[str] = "actor-critic with two critics, without demonstrations"
    paper: ClassVar[str] = "Fujimoto et al., 2018; Eq. 4.1-4.9"

    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    random_steps: Annotated[int, Range(0, MANY)] = 0
    """steps before the first gradient step in which actions are drawn at random"""
    learner: TD3Config = field(default_factory=TD3Config)
    """of the update"""

    def learning(self, problem: Problem) -> Learning:
        """TD3 on a uniform replay."""
        return actor_critic(problem, self.learner)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """Random first actions, then the actor with noise."""
        strategy: Strategy = agent_strategy(problem, learner, self.noise)
        if self.random_steps:
            strategy = RandomStart(strategy, self.random_steps, problem.action_size, problem.draws)
        return strategy
