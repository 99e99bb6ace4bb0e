"""A run's checkpoint, from which training goes on."""

from functools import lru_cache
from pathlib import Path

from rled_agent.training.run_directory import RunDirectory

from .. import agent
from ..mutators.values import mutate_tensors as mutate

__all__ = ["mutate", "read", "seeds"]


@lru_cache
def seeds() -> list[bytes]:
    with agent.folder() as folder:
        run = RunDirectory(folder)
        run.save(*agent.trainer().checkpoints())
        return [run.checkpoint_path.read_bytes()]


def read(data: bytes, folder: Path) -> None:
    run, trainer = RunDirectory(folder), agent.trainer()
    run.checkpoint_path.write_bytes(data)
    trainer.restore([run.load()])
    trainer.advance()
    run.save(*trainer.checkpoints())
