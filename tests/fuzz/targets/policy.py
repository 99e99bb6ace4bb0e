"""Weights of a policy."""

from functools import lru_cache
from pathlib import Path

import numpy as np
from rled_agent.nn.policy import load_policy

from .. import agent
from ..mutators.values import mutate_tensors as mutate

__all__ = ["mutate", "read", "seeds"]


@lru_cache
def seeds() -> list[bytes]:
    with agent.folder() as folder:
        for number, policy in enumerate(agent.policies()):
            policy.save(folder / f"{number}.safetensors")
        return [path.read_bytes() for path in sorted(folder.glob("*"))]


def read(data: bytes, folder: Path) -> None:
    path = folder / "policy.safetensors"
    path.write_bytes(data)
    policy = load_policy(path)
    low, high = policy.task.observation_bounds()
    action = policy.act((low + high) / 2.0)
    assert action.shape == (policy.task.action_size,)
    assert np.isfinite(action).all(), "an action that is no number"
    policy.save(folder / "again.safetensors")
