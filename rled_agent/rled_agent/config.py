"""Settings of a training run."""

import dataclasses
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from rled_msgs_py.errors import ContractError
from rled_msgs_py.validation import Range, check_fields, from_object
from rled_sim.faults import Faults
from rled_sim.tasks import MOST_SPREAD

from rled_agent.bounds import MANY, Amount, Count, Seed, Share
from rled_agent.learners.td3 import LearnerConfig
from rled_agent.uncertainty import GateSettings, Measure, Passes

MOST_ROWS = 10_000_000
"""Transitions of a replay: more than a gigabyte on the Panda."""


@dataclass(frozen=True)
class BehaviourConfig:
    """Who acts while learning."""

    name: Literal["biased", "gate", "jump_start", "proposal"] = "biased"
    """biased: the expert drives an episode with probability phi; gate: it acts where the actor is unsure; jump_start:
    it begins each episode (JSRL); proposal: it acts where the critics prefer its action (IBRL)"""
    phi: Share = 0.1
    """probability of policy reuse Φ (Eq. 4.11); 0 is pure TD3"""
    threshold: Amount = 1e-3
    """ξ of Eq. 4.40: at this uncertainty or more the expert acts"""
    measure: Measure = "qcd"
    """qcd: quartile coefficient of dispersion (Eq. 4.39); iqr: interquartile range over the action range"""
    passes: Passes = 30
    """N, stochastic passes of the actor; only an actor with dropout is asked for its uncertainty"""
    noise: Annotated[float, Range(0, 10)] = 0.1
    """δ, deviation of the exploration noise, in halves of the action range"""
    guide_steps: Annotated[int, Range(0, MANY)] = 60
    """jump_start: steps of an episode in which the expert acts, in the first stage"""
    guide_stages: Count = 10
    """jump_start: stages after which it acts no more"""
    guide_tolerance: Amount = 0.1
    """jump_start: share of the best mean return that may lack for the next stage"""

    @property
    def gate(self) -> GateSettings | None:
        """What the Monte-Carlo gate compares; None where another behaviour acts."""
        return GateSettings(self.measure, self.threshold, self.passes) if self.name == "gate" else None


@dataclass(frozen=True)
class ScheduleConfig:
    """When to act, to learn, to look and to save, in environment steps."""

    steps: Count = 150_000
    """environment steps in all"""
    train_after: Count = 10_000
    """steps before the first gradient step"""
    train_every: Count = 1_000
    """steps between bursts of gradient steps"""
    gradient_steps: Annotated[int, Range(0, MANY)] = 1_000
    """K, gradient steps in a burst"""
    batch_size: Annotated[int, Range(1, 1_000_000)] = 100
    """transitions in a gradient step"""
    expert_share: Share = 0.0
    """share of each batch that is drawn from the demonstrations instead of the replay"""
    preload: Annotated[int, Range(0, MOST_ROWS)] = 0
    """demonstrated transitions put into the replay before the first step"""
    capacity: Annotated[int, Range(1, MOST_ROWS)] = 1_000_000
    """transitions kept for replay"""
    evaluate_every: Count = 5_000
    """steps between evaluations, a multiple of log_every"""
    evaluation_episodes: Annotated[int, Range(1, 100_000)] = 20
    """episodes in an evaluation"""
    log_every: Count = 1_000
    """steps between rows of metrics.csv"""
    checkpoint_every: Count = 10_000
    """steps between checkpoints, a multiple of log_every"""


@dataclass(frozen=True)
class TrainConfig:
    """Everything that decides a run besides its demonstrations."""

    env: str = "rled/PandaReach-v0"
    """Gymnasium environment"""
    reward: Literal["dense", "sparse", "own"] = "dense"
    """reward function of section 4.1.3; own: what the environment pays"""
    target_spread: Annotated[float, Range(0, MOST_SPREAD)] = 0.0
    """how far beside the curve targets lie at most, along each axis (m); over the graph it is sim_node's"""
    seed: Seed = 0
    """of everything that is drawn; the same seed gives the same run"""
    behaviour: BehaviourConfig = field(default_factory=BehaviourConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    faults: Faults = field(default_factory=Faults)
    """on purpose, in process; over the graph they are those of sim_node"""

    def __post_init__(self) -> None:
        check_fields(self)
        if dropout := self.learner.critic.dropout:
            raise ContractError(f"learner.critic.dropout is {dropout}", "0", "critics drop no units")
        for name in ("evaluate_every", "checkpoint_every"):
            value, log_every = getattr(self.schedule, name), self.schedule.log_every
            if value % log_every:
                raise ContractError(f"schedule.{name} is {value}", f"a multiple of schedule.log_every ({log_every})")

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return dataclasses.asdict(self)

    @staticmethod
    def from_dict(values: Any) -> "TrainConfig":
        """Read what ``to_dict`` gave, after a way through JSON, from wherever it comes.

        Raises:
            ContractError: fields missing, unknown, of another kind or out of their range, or an environment that is
                to be imported from a module: what stands in a file makes no code run.
        """
        config = from_object(TrainConfig, values, "config")
        if ":" in config.env:
            raise ContractError(f"config.env is '{config.env[:80]}'", "the name of a registered environment")
        return config
