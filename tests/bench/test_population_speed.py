"""Eight seeds made by one process against the same runs side by side, and updates of many seeds in all."""

import os
import statistics
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from rled_agent.training.tables import read_rows

from .conftest import wanted
from .population import rate

ROUNDS = 3
LOG = ("--schedule.log-every", "200", "--schedule.evaluate-every", "100000", "--schedule.checkpoint-every", "100000")
CASES = {
    "planar_mc_tuned": (("--schedule.steps", "2000"), 0.9),
    "td3": (("--schedule.steps", "800", "--schedule.train-after", "100"), 1.2),
}
COMMAND = [sys.executable, "-m", "rled_agent.cli.train_agent"]


@pytest.fixture(scope="session")
def expert(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("expert")
    cloned = ["--bag", "bags/planar_lemniscate", "--steps", "2000", "--output", str(folder)]
    subprocess.run([sys.executable, "-m", "rled_agent.cli.train_expert", *cloned], check=True, capture_output=True)
    return folder


def at_once(command: list[str], folder: Path) -> float:
    """Seconds of eight seeds in one process, with as many threads as there are processors, without its start."""
    subprocess.run([*command, "--seeds", "0-7", "--output", str(folder)], check=True, capture_output=True)
    return seconds(folder / "seed-0")


def side_by_side(command: list[str], folder: Path) -> float:
    """Seconds of eight runs, two processes at a time on one thread each: four times those of a pair."""
    env = os.environ | {"OMP_NUM_THREADS": "1"}
    quiet = {"env": env, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    folders = [folder / str(seed) for seed in range(2)]
    pair = [
        subprocess.Popen([*command, "--seed", str(seed), "--output", str(each)], **quiet)
        for seed, each in enumerate(folders)
    ]
    assert [each.wait() for each in pair] == [0, 0]
    return 4.0 * statistics.mean(map(seconds, folders))


def seconds(folder: Path) -> float:
    """Of a run's steps."""
    row = read_rows(folder / "metrics.csv")[-1]
    return row["step"] / row["steps_per_second"]


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", CASES)
def test_eight_seeds_at_once_take_no_longer_than_side_by_side(name, expert, tmp_path, figure):
    options, most = CASES[name]
    given = ["--bag", "bags/planar_lemniscate", "--expert", str(expert)] if name == "planar_mc_tuned" else []
    command = [*COMMAND, name, *options, *LOG, *given]
    ratios = [
        at_once(command, tmp_path / f"at-once-{k}") / side_by_side(command, tmp_path / f"side-by-side-{k}")
        for k in range(ROUNDS)
    ]
    figure(f"population_vs_side_by_side_{name}", statistics.median(ratios))
    wanted(statistics.median(ratios) <= most, f"population_vs_side_by_side_{name} of {most} at most")


def test_many_seeds_learn_in_one_process(figure):
    """Of plain TD3 on the Panda, a step of each environment for each update: updates a second of all seeds."""
    threads = torch.get_num_threads()
    for seeds in (1, 8):
        figure(f"population_updates_per_s_{seeds}", rate(seeds, "cpu", seconds=5.0).updates)
    torch.set_num_threads(threads)
