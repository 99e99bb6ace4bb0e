"""Settings of a training run."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, Literal

from rled_msgs_py.errors import RledError
from rled_sim.faults import Faults
from rled_sim.tasks import MOST_SPREAD

from rled_agent.learners.td3 import LearnerConfig
from rled_agent.nn.architecture import Architecture
from rled_agent.uncertainty import Measure


class ConfigError(RledError):
    """A setting out of its range."""


def require_ranges(settings: Any, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Refuse settings outside closed ranges, by dotted name; of a tuple, each part is looked at.

    Raises:
        ConfigError: names the setting, its value and the range.
    """
    for name, (low, high) in ranges.items():
        value = attrgetter(name)(settings)
        if not all(low <= each <= high for each in (value if isinstance(value, tuple) else (value,))):
            raise ConfigError(f"{name} is {value}", f"{low:g} to {high:g}")


@dataclass(frozen=True)
class BehaviourConfig:
    """Who acts while learning."""

    name: Literal["biased", "gate", "jump_start", "proposal"] = "biased"
    """biased: the expert drives an episode with probability phi; gate: it acts where the actor is unsure; jump_start:
    it begins each episode (JSRL); proposal: it acts where the critics prefer its action (IBRL)"""
    phi: float = 0.1
    """probability of policy reuse Φ (Eq. 4.11); 0 is pure TD3"""
    threshold: float = 1e-3
    """ξ of Eq. 4.40: at this uncertainty or more the expert acts"""
    measure: Measure = "qcd"
    """qcd: quartile coefficient of dispersion (Eq. 4.39); iqr: interquartile range over the action range"""
    passes: int = 30
    """N, stochastic passes of the actor; only an actor with dropout is asked for its uncertainty"""
    noise: float = 0.1
    """δ, deviation of the exploration noise, in halves of the action range"""
    guide_steps: int = 60
    """jump_start: steps of an episode in which the expert acts, in the first stage"""
    guide_stages: int = 10
    """jump_start: stages after which it acts no more"""
    guide_tolerance: float = 0.1
    """jump_start: share of the best mean return that may lack for the next stage"""


@dataclass(frozen=True)
class ScheduleConfig:
    """When to act, to learn, to look and to save, in environment steps."""

    steps: int = 150_000
    """environment steps in all"""
    train_after: int = 10_000
    """steps before the first gradient step"""
    train_every: int = 1_000
    """steps between bursts of gradient steps"""
    gradient_steps: int = 1_000
    """K, gradient steps in a burst"""
    batch_size: int = 100
    """transitions in a gradient step"""
    expert_share: float = 0.0
    """share of each batch that is drawn from the demonstrations instead of the replay"""
    preload: int = 0
    """demonstrated transitions put into the replay before the first step"""
    capacity: int = 1_000_000
    """transitions kept for replay"""
    evaluate_every: int = 5_000
    """steps between evaluations, a multiple of log_every"""
    evaluation_episodes: int = 20
    """episodes in an evaluation"""
    log_every: int = 1_000
    """steps between rows of metrics.csv"""
    checkpoint_every: int = 10_000
    """steps between checkpoints, a multiple of log_every"""


@dataclass(frozen=True)
class TrainConfig:
    """Everything that decides a run besides its demonstrations."""

    env: str = "rled/PandaReach-v0"
    """Gymnasium environment"""
    reward: Literal["dense", "sparse", "own"] = "dense"
    """reward function of section 4.1.3; own: what the environment pays"""
    target_spread: float = 0.0
    """how far beside the curve targets lie at most, along each axis (m); over the graph it is sim_node's"""
    seed: int = 0
    """of everything that is drawn; the same seed gives the same run"""
    behaviour: BehaviourConfig = field(default_factory=BehaviourConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    faults: Faults = field(default_factory=Faults)
    """on purpose, in process; over the graph they are those of sim_node"""

    def __post_init__(self) -> None:
        require_ranges(self, RANGES)
        for name in ("evaluate_every", "checkpoint_every"):
            value, log_every = getattr(self.schedule, name), self.schedule.log_every
            if value % log_every:
                raise ConfigError(f"schedule.{name} is {value}", f"a multiple of schedule.log_every ({log_every})")

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return dataclasses.asdict(self)

    @staticmethod
    def from_dict(values: dict[str, Any]) -> "TrainConfig":
        """Read what ``to_dict`` gave, also after a way through JSON.

        Raises:
            ConfigError: fields of another version.
        """
        try:
            networks = {name: _architecture(values["learner"][name]) for name in ("actor", "critic")}
            return TrainConfig(
                env=values["env"],
                reward=values["reward"],
                target_spread=values["target_spread"],
                seed=values["seed"],
                behaviour=BehaviourConfig(**values["behaviour"]),
                schedule=ScheduleConfig(**values["schedule"]),
                learner=LearnerConfig(**values["learner"] | networks),
                faults=Faults(**values.get("faults", {})),
            )
        except (KeyError, TypeError) as error:
            raise ConfigError(f"settings of another version ({error})", "those of this version's train_agent") from None


def _architecture(values: dict[str, Any]) -> Architecture:
    return Architecture(**values | {"hidden": tuple(values["hidden"])})


MANY = 10**12
SEEDS = (0, 2**63 - 1)
WIDTHS = (1, 100_000)
RANGES: dict[str, tuple[float, float]] = {
    "target_spread": (0, MOST_SPREAD),
    "seed": SEEDS,
    "behaviour.phi": (0, 1),
    "behaviour.threshold": (0, MANY),
    "behaviour.passes": (2, 10_000),
    "behaviour.noise": (0, 10),
    "behaviour.guide_steps": (0, MANY),
    "behaviour.guide_stages": (1, MANY),
    "behaviour.guide_tolerance": (0, MANY),
    "schedule.steps": (1, MANY),
    "schedule.train_after": (1, MANY),
    "schedule.train_every": (1, MANY),
    "schedule.gradient_steps": (0, MANY),
    "schedule.batch_size": (1, 1_000_000),
    "schedule.expert_share": (0, 1),
    "schedule.preload": (0, 1e8),
    "schedule.capacity": (1, 1e9),
    "schedule.evaluate_every": (1, MANY),
    "schedule.evaluation_episodes": (1, 100_000),
    "schedule.log_every": (1, MANY),
    "schedule.checkpoint_every": (1, MANY),
    "learner.gamma": (0, 1),
    "learner.reward_scale": (0, MANY),
    "learner.actor_rate": (0, 1),
    "learner.critic_rate": (0, 1),
    "learner.rate_decay": (0, MANY),
    "learner.tau": (0, 1),
    "learner.critics": (1, 2),
    "learner.delay": (1, 1000),
    "learner.target_noise": (0, 10),
    "learner.target_clip": (0, 10),
    "learner.cloning_weight": (0, 1e6),
    "learner.actor.hidden": WIDTHS,
    "learner.actor.dropout": (0, 0.95),
    "learner.critic.hidden": WIDTHS,
    "learner.critic.dropout": (0, 0),
}
"""Closed ranges; the update drops no units of a critic."""
