"""Settings of a training run."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import tyro
from rled_msgs_py.errors import ContractError
from rled_msgs_py.validation import Range, check_fields, from_object
from rled_sim.faults import Faults
from rled_sim.tasks import MAX_TARGET_SPREAD

from rled_agent.bounds import MANY, MAX_TRANSITIONS, Count, Seed
from rled_agent.methods.method import Method


@dataclass(frozen=True)
class Schedule:
    """When to act, to learn, to look and to save, in environment steps."""

    steps: Count = 60_000
    """environment steps in all"""
    train_after: Count = 1_000
    """steps before the first gradient step"""
    train_every: Count = 1
    """steps between bursts of gradient steps"""
    gradient_steps: Annotated[int, Range(0, MANY)] = 1
    """K, gradient steps in a burst"""
    batch_size: Annotated[int, Range(1, 1_000_000)] = 100
    """transitions in a gradient step"""
    capacity: Annotated[int, Range(1, MAX_TRANSITIONS)] = 1_000_000
    """transitions kept for replay"""
    evaluate_every: Count = 2_000
    """steps between evaluations, a multiple of log_every"""
    evaluation_episodes: Annotated[int, Range(1, 100_000)] = 20
    """episodes in an evaluation"""
    log_every: Count = 1_000
    """steps between rows of metrics.csv"""
    checkpoint_every: Count = 10_000
    """steps between checkpoints, a multiple of log_every"""

    def __post_init__(self) -> None:
        check_fields(self, "schedule.")
        for name in ("evaluate_every", "checkpoint_every"):
            value = getattr(self, name)
            if value % self.log_every:
                raise ContractError(
                    f"schedule.{name} is {value}", f"a multiple of schedule.log_every ({self.log_every})"
                )


@dataclass(frozen=True)
class TrainConfig:
    """Everything that decides a run besides its demonstrations."""

    method: Annotated[Method, tyro.conf.arg(name="")]
    """what learns, and who acts meanwhile"""
    env: str = "rled/PandaReach-v0"
    """Gymnasium environment"""
    reward: Literal["dense", "sparse", "own"] = "sparse"
    """reward function of section 4.1.3; own: what the environment pays"""
    target_spread: Annotated[float, Range(0, MAX_TARGET_SPREAD)] = 0.0
    """how far beside the curve targets lie at most, along each axis (m); over the graph it is sim_node's"""
    seed: Seed = 0
    """of everything that is drawn; the same seed gives the same run"""
    schedule: Schedule = field(default_factory=Schedule)
    """when to act, to learn, to look and to save"""
    faults: Faults = field(default_factory=Faults)
    """on purpose, in process; over the graph they are those of sim_node"""

    def __post_init__(self) -> None:
        check_fields(self)
        check_fields(self.method)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; the method by its name, and its settings."""
        plain = dataclasses.asdict(self)
        return {"method": self.method.name, "settings": plain.pop("method")} | plain

    @staticmethod
    def from_dict(values: Any, methods: Mapping[str, type[Method]]) -> "TrainConfig":
        """Read what ``to_dict`` gave, after a way through JSON, from wherever it comes.

        Args:
            values: what was read.
            methods: all there are, by name.

        Raises:
            ContractError: an unknown method, fields missing, unknown, of another kind or out of their range, or an
                environment that is to be imported from a module: what stands in a file makes no code run.
        """
        if not isinstance(values, dict) or not {"method", "settings"} <= set(values):
            raise ContractError("config names no method with its settings", "a run that this version began")
        name, settings, rest = values["method"], values["settings"], {**values}
        if not isinstance(name, str) or name not in methods:
            raise ContractError(f"config.method is '{str(name)[:80]}'", ", ".join(methods))
        del rest["method"], rest["settings"]
        method = from_object(methods[name], settings, "config.settings")
        config = from_object(TrainConfig, rest, "config", {"method": method})
        if ":" in config.env:
            raise ContractError(f"config.env is '{config.env[:80]}'", "the name of a registered environment")
        return config
