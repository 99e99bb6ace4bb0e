"""``metrics.csv`` of a run: gone on with, and drawn."""

from functools import lru_cache
from pathlib import Path

from rled_agent.experiments.statistics import common, estimate, read_curve
from rled_agent.run_directory import RunDirectory
from rled_msgs_py.errors import RledError

from .. import agent
from ..mutators.lines import mutate as mutate
from . import checkpoint

ROW = {"step": 10.0, "reward": -3.5, "evaluation_reward": float("nan"), "evaluation_steps": float("nan")}


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
    try:
        curve = read_curve(run.metrics_path, "evaluation_reward")
    except RledError:
        pass
    else:
        if len(curve.values):
            common([curve, curve]), estimate(curve.values.tolist()), curve.smoothed(2)
    run.load()
    run.append(ROW)
    run.ends_in_the_best()
