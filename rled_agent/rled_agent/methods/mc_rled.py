"""MC RLED: where Monte-Carlo dropout shows the actor to be unsure, the expert acts."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from rled_msgs_py.validation import Range

from rled_agent.bounds import Amount, Share
from rled_agent.exploration.agent import Noise
from rled_agent.exploration.strategy import Strategy
from rled_agent.exploration.uncertainty_gate import UncertaintyGate
from rled_agent.learners.actor_losses import Cloning
from rled_agent.learners.td3 import TD3Config, TD3Learner
from rled_agent.methods.actor_critic import actor_critic
from rled_agent.methods.method import Learning, Method, Problem
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.policy import GateSettings, Passes
from rled_agent.per_seed import PER_SEED
from rled_agent.uncertainty.uncertainty import make_uncertainty


def _dropping() -> TD3Config:
    return TD3Config(actor=Architecture(hidden=(128, 128), dropout=0.1), critic=Architecture(hidden=(128, 128)))


@dataclass(frozen=True)
class MCRLED(Method):
    """The Monte-Carlo gate (Eq. 4.38-4.40): at u_t ≥ ξ the expert acts, below it the mean of N stochastic passes.

    Beyond the thesis, demonstrations may make up a share of each batch, and the actor may clone them beside Q.
    """

    title: ClassVar[str] = "where the actor's dropout shows it to be unsure, the expert acts"
    paper: ClassVar[str] = "thesis, section 4.2, Eq. 4.38-4.40"
    needs: ClassVar[tuple[str, ...]] = ("expert",)

    threshold: Annotated[Amount, PER_SEED] = 1e-3
    """ξ of Eq. 4.40: at this uncertainty or more the expert acts"""
    measure: Literal["qcd", "iqr"] = "qcd"
    """qcd: quartile coefficient of dispersion (Eq. 4.39); iqr: interquartile range over the action range"""
    passes: Passes = 30
    """N, stochastic passes of the actor"""
    noise: Annotated[float, Range(0, 10), PER_SEED] = 0.1
    """δ, std of the exploration noise, in halves of the action range"""
    demonstrated_share: Share = 0.0
    """share of each batch that is drawn from the demonstrations instead of the replay"""
    cloning: Cloning = field(default_factory=lambda: Cloning(0.0))
    """beside the policy gradient"""
    learner: TD3Config = field(default_factory=_dropping)
    """of the update"""

    @property
    def gate(self) -> GateSettings:
        """What Eq. 4.40 compares."""
        return GateSettings(self.measure, self.threshold, self.passes)

    def learning(self, problem: Problem) -> Learning:
        """TD3 on a replay, mixed with demonstrations."""
        return actor_critic(problem, self.learner, self.cloning.loss(), share=self.demonstrated_share)

    def strategy(self, problem: Problem, learner: TD3Learner) -> Strategy:
        """The gate."""
        expert, noise = problem.require_expert(self.name), Noise(self.noise, problem.draws)
        compared = GateSettings(self.measure, passes=self.passes)
        uncertainty = make_uncertainty(compared, learner.actor, None, problem.draws)
        return UncertaintyGate(uncertainty, expert, noise, self.measure, self.threshold)
