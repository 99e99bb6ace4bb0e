"""The settings of a run folder."""

import json
from functools import lru_cache
from pathlib import Path

from rled_agent.methods import all_methods
from rled_agent.training.config import TrainConfig
from rled_agent.training.run_directory import RunDirectory

from .. import agent
from ..mutators.values import json_text as mutate

__all__ = ["mutate", "read", "seeds"]


@lru_cache
def seeds() -> list[bytes]:
    with agent.folder() as folder:
        run = RunDirectory(folder)
        run.create({"config": agent.config().to_dict(), "bag": "bags/planar"})
        return [run.config_path.read_bytes()]


def read(data: bytes, folder: Path) -> None:
    run = RunDirectory(folder)
    run.config_path.write_bytes(data)
    values = run.config()
    assert isinstance(values, dict), f"settings that are a {type(values).__name__}"
    config = TrainConfig.from_dict(values.get("config", {}), all_methods())
    assert TrainConfig.from_dict(json.loads(json.dumps(config.to_dict())), all_methods()) == config
