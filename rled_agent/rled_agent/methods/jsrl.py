"""JSRL: the expert begins each episode, ever more briefly."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from rled_msgs_py.validation import Range

from rled_agent.bounds import MANY, Amount, Count
from rled_agent.exploration.agent import Noise
from rled_agent.exploration.jump_start import JumpStart
from rled_agent.exploration.strategy import Strategy, network_function
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.per_seed import PER_SEED


@dataclass(frozen=True)
class JSRL(Method):
    """Jump-Start RL: a guide acts first, in each stage for fewer steps, and hands over to the actor."""

    title: ClassVar[str] = "the expert begins each episode, in each stage for fewer steps"
    paper: ClassVar[str] = "Uchendu et al., 2023"
    needs: ClassVar[tuple[str, ...]] = ("expert",)

    guide_steps: Annotated[int, Range(0, MANY)] = 60
    """steps of an episode in which the expert acts, in the first stage"""
    guide_stages: Count = 10
    """stages after which it acts no more"""
    guide_tolerance: Annotated[Amount, PER_SEED] = 0.1
    """share of the best mean return that may lack for the next stage"""
    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    learner: TD3Config = field(default_factory=lambda: TD3Config(gamma=0.9, reward_scale=1e-3))
    """of the update"""

    def learning(self, problem: Problem) -> Learning:
        """TD3 on a uniform replay."""
        return actor_critic(problem, self.learner)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """Guide and actor."""
        expert, noise = problem.require_expert(self.name), Noise(self.noise, problem.draws)
        policy = network_function(learner.actor)
        return JumpStart(policy, expert, noise, self.guide_steps, self.guide_stages, self.guide_tolerance)
