"""Robot learning from expert demonstrations: read a bag, clone an expert, train, evaluate.

These names are what a notebook or another package may use; everything else may change. They are imported when first
used, so that a command pays only for what it needs.

Example:
    >>> demonstrations = open_demonstrations("bags/planar_lemniscate")
    >>> expert = clone(demonstrations, CloningConfig(steps=4000))
    >>> agent = train(PRESETS["planar_mc_tuned"].config, demonstrations, expert, output="out/run")
    >>> evaluate(agent, demonstrations)["targets_reached"]
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rled_agent.api import clone, evaluate, train
    from rled_agent.cli.presets import PRESETS
    from rled_agent.data.demonstrations import Demonstrations
    from rled_agent.data.opening import open_demonstrations
    from rled_agent.learners.cloning import CloningConfig
    from rled_agent.learners.td3 import TD3Config, TD3Learner
    from rled_agent.methods import Learning, Method, Problem, all_methods
    from rled_agent.methods.actor_critic import agent_strategy
    from rled_agent.nn.policy import Policy, load_policy
    from rled_agent.training.config import Schedule, TrainConfig

_HOMES = {
    "CloningConfig": "learners.cloning",
    "Demonstrations": "data.demonstrations",
    "Learning": "methods",
    "Method": "methods",
    "PRESETS": "cli.presets",
    "Policy": "nn.policy",
    "Problem": "methods",
    "Schedule": "training.config",
    "TD3Config": "learners.td3",
    "TD3Learner": "learners.td3",
    "TrainConfig": "training.config",
    "agent_strategy": "methods.actor_critic",
    "clone": "api",
    "evaluate": "api",
    "load_policy": "nn.policy",
    "all_methods": "methods",
    "open_demonstrations": "data.opening",
    "train": "api",
}

__all__ = [
    "PRESETS",
    "CloningConfig",
    "Demonstrations",
    "Learning",
    "Method",
    "Policy",
    "Problem",
    "Schedule",
    "TD3Config",
    "TD3Learner",
    "TrainConfig",
    "agent_strategy",
    "all_methods",
    "clone",
    "evaluate",
    "load_policy",
    "open_demonstrations",
    "train",
]


def __getattr__(name: str) -> Any:
    """A public name, from its home."""
    if name not in _HOMES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """The public names, for completion."""
    return __all__
