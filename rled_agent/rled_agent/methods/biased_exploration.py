"""Biased exploration: the expert drives some of the episodes."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from rled_msgs_py.validation import Range

from rled_agent.bounds import Share
from rled_agent.exploration.policy_reuse import PolicyReuse
from rled_agent.exploration.strategy import Strategy
from rled_agent.learners.actor_losses import Cloning
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic, agent_strategy, recorded_uncertainty
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.nn.policy import Passes
from rled_agent.per_seed import PER_SEED


@dataclass(frozen=True)
class BiasedExploration(Method):
    """With probability Φ the expert drives a whole episode (Algorithm 2); the rest is TD3.

    Beyond the thesis, demonstrations may make up a share of each batch, and the actor may clone them beside Q.
    """

    title: ClassVar[str] = "the expert drives an episode with probability Φ"
    paper: ClassVar[str] = "thesis, section 4.1, Algorithm 2"
    needs: ClassVar[tuple[str, ...]] = ("expert",)

    phi: Annotated[Share, PER_SEED] = 0.1
    """probability of policy reuse Φ (Eq. 4.11); 0 leaves the expert out"""
    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    passes: Passes = 30
    """N, stochastic passes of an actor with dropout, whose uncertainty is recorded"""
    demonstrated_share: Share = 0.0
    """share of each batch that is drawn from the demonstrations instead of the replay"""
    cloning: Cloning = field(default_factory=lambda: Cloning(0.0))
    """beside the policy gradient"""
    learner: TD3Config = field(default_factory=TD3Config)
    """of the update"""

    def learning(self, problem: Problem) -> Learning:
        """TD3 on a replay, mixed with demonstrations."""
        return actor_critic(problem, self.learner, self.cloning.loss(), share=self.demonstrated_share)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """The expert in drawn episodes, the actor with noise in the others."""
        expert = problem.require_expert(self.name)
        unsure = recorded_uncertainty(problem, learner, self.passes)
        acting = agent_strategy(problem, learner, self.noise, unsure)
        return PolicyReuse(acting, expert, self.phi, problem.draws)
