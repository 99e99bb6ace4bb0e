"""``metrics.csv`` of a run that is gone on with."""

from functools import lru_cache
from pathlib import Path

from rled_agent.training.run_directory import RunDirectory

from .. import agent
from ..mutators.texts import mutate_lines as mutate
from . import checkpoint

__all__ = ["mutate", "read", "seeds"]

ROW = {"step": 10.0, "reward": -3.5, "evaluation_reward": float("nan"), "evaluation_steps": 20.0}


@lru_cache
def seeds() -> list[bytes]:
    with agent.folder() as folder:
        run = RunDirectory(folder)
        for step in (10.0, 20.0):
            run.append(ROW | {"step": step, "evaluation_reward": -step})
        return [run.metrics_path.read_bytes()]


def read(data: bytes, folder: Path) -> None:
    run = RunDirectory(folder)
    run.checkpoint_path.write_bytes(checkpoint.seeds()[0])
    run.metrics_path.write_bytes(data)
    run.load()
    run.append(ROW)
    run.ends_in_the_best()
    again = RunDirectory(folder)
    again.load()
