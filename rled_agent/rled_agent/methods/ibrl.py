"""IBRL: actor and expert propose, the critics choose, for acting and for targets."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from rled_msgs_py.validation import Range

from rled_agent.bounds import MAX_TRANSITIONS
from rled_agent.exploration.agent import Noise
from rled_agent.exploration.proposals import Proposals
from rled_agent.exploration.strategy import Strategy, network_function
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.nn.architecture import Architecture
from rled_agent.per_seed import PER_SEED


def _normalised() -> TD3Config:
    return TD3Config(gamma=0.9, reward_scale=1e-3, critic=Architecture(layer_norm=True))


@dataclass(frozen=True)
class IBRL(Method):
    """Imitation Bootstrapped RL: the better of the actor's and the expert's action, by the target critics."""

    title: ClassVar[str] = "the critics choose between the actor's and the expert's action"
    paper: ClassVar[str] = "Hu et al., 2024"
    needs: ClassVar[tuple[str, ...]] = ("expert", "demonstrations")

    preload: Annotated[int, Range(0, MAX_TRANSITIONS)] = 50_000
    """demonstrated transitions put into the replay before the first step"""
    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    learner: TD3Config = field(default_factory=_normalised)
    """of the update"""

    def learning(self, problem: Problem) -> Learning:
        """TD3 whose targets may take the expert's action, on a replay that begins with demonstrations."""
        return actor_critic(problem, self.learner, preload=self.preload, proposal=problem.expert)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """The proposal of greater value."""
        expert, noise = problem.require_expert(self.name), Noise(self.noise, problem.draws)
        return Proposals(network_function(learner.actor), expert, noise, learner.value)
