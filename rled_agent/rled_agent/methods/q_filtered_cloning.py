"""Cloning with a Q-filter: the actor also clones demonstrations, where the critic agrees with them."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from rled_msgs_py.validation import Range

from rled_agent.bounds import Share
from rled_agent.exploration.strategy import Strategy
from rled_agent.learners.actor_losses import Cloning
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic, agent_strategy
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.per_seed import PER_SEED


@dataclass(frozen=True)
class QFilteredCloning(Method):
    """A share of each batch is demonstrated, and the actor clones it beside the policy gradient."""

    title: ClassVar[str] = "the actor also clones demonstrations, where the critic agrees"
    paper: ClassVar[str] = "Nair et al., 2018, without resets and hindsight"
    needs: ClassVar[tuple[str, ...]] = ("demonstrations",)

    demonstrated_share: Share = 0.5
    """share of each batch that is drawn from the demonstrations instead of the replay"""
    cloning: Cloning = field(default_factory=Cloning)
    """beside the policy gradient"""
    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    learner: TD3Config = field(default_factory=lambda: TD3Config(gamma=0.9, reward_scale=1e-3))
    """of the update"""

    def learning(self, problem: Problem) -> Learning:
        """TD3 on a mixture of replay and demonstrations, with a cloning error in the actor's loss."""
        return actor_critic(problem, self.learner, self.cloning.loss(), share=self.demonstrated_share)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """The actor with noise."""
        return agent_strategy(problem, learner, self.noise)
