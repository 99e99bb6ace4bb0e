"""RLPD: half of each batch comes from the demonstrations, and the critics are normalised."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from rled_msgs_py.validation import Range

from rled_agent.bounds import Share
from rled_agent.exploration.strategy import Strategy
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic, agent_strategy
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.nn.architecture import Architecture
from rled_agent.per_seed import PER_SEED


def _normalised() -> TD3Config:
    return TD3Config(gamma=0.9, reward_scale=1e-3, rate_decay=10_000.0, critic=Architecture(layer_norm=True))


@dataclass(frozen=True)
class RLPD(Method):
    """RL with Prior Data, of which symmetric sampling and LayerNorm critics are kept; the learner is TD3, not SAC."""

    title: ClassVar[str] = "half of each batch is demonstrated, LayerNorm critics"
    paper: ClassVar[str] = "Ball et al., 2023"
    needs: ClassVar[tuple[str, ...]] = ("demonstrations",)

    demonstrated_share: Share = 0.5
    """share of each batch that is drawn from the demonstrations instead of the replay"""
    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    learner: TD3Config = field(default_factory=_normalised)
    """of the update"""

    def learning(self, problem: Problem) -> Learning:
        """TD3 on a mixture of replay and demonstrations."""
        return actor_critic(problem, self.learner, share=self.demonstrated_share)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """The actor with noise."""
        return agent_strategy(problem, learner, self.noise)
