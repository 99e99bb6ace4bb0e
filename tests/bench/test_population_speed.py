"""Eight seeds made by one process against the same runs side by side, and updates of many seeds in all."""

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from .conftest import wanted
from .population import rate

ROUNDS = 3
SMALL_LOG = (
    "--schedule.log-every",
    "500",
    "--schedule.evaluate-every",
    "100000",
    "--schedule.checkpoint-every",
    "100000",
)
CASES = {
    "planar_mc_tuned": (("--schedule.steps", "2500"), 0.9),
    "td3": (("--schedule.steps", "1500", "--schedule.train-after", "200"), 1.2),
}
COMMAND = [sys.executable, "-m", "rled_agent.cli.train_agent"]


@pytest.fixture(scope="session")
def expert(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("expert")
    cloned = ["--bag", "bags/planar_lemniscate", "--steps", "2000", "--output", str(folder)]
    subprocess.run([sys.executable, "-m", "rled_agent.cli.train_expert", *cloned], check=True, capture_output=True)
    return folder


def at_once(command: list[str], folder: Path) -> None:
    """Eight seeds in one process, with as many threads as there are processors."""
    subprocess.run([*command, "--seeds", "0-7", "--output", str(folder)], check=True, capture_output=True)


def side_by_side(command: list[str], folder: Path) -> None:
    """Two processes of four runs, one after the other, each on one thread."""
    env = os.environ | {"OMP_NUM_THREADS": "1"}
    for k in range(4):
        pair = [
            subprocess.Popen(
                [*command, "--seed", str(seed), "--output", str(folder / str(seed))],
                env=env,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            for seed in (k, k + 4)
        ]
        assert [each.wait() for each in pair] == [0, 0]


@pytest.mark.parametrize("name", CASES)
def test_eight_seeds_at_once_take_no_longer_than_side_by_side(name, expert, tmp_path, figure):
    options, most = CASES[name]
    given = ["--bag", "bags/planar_lemniscate", "--expert", str(expert)] if name == "planar_mc_tuned" else []
    command, ratios = [*COMMAND, name, *options, *SMALL_LOG, *given], []
    for k in range(ROUNDS):
        seconds = []
        for make in (at_once, side_by_side):
            begun = time.perf_counter()
            make(command, tmp_path / f"{make.__name__}-{k}")
            seconds.append(time.perf_counter() - begun)
        ratios.append(seconds[0] / seconds[1])
    figure(f"population_vs_side_by_side_{name}", statistics.median(ratios))
    wanted(statistics.median(ratios) <= most, f"population_vs_side_by_side_{name} of {most} at most")


def test_many_seeds_learn_in_one_process(figure):
    """Of plain TD3 on the Panda, a step of each environment for each update: updates a second of all seeds."""
    threads = torch.get_num_threads()
    for seeds in (1, 8):
        figure(f"population_updates_per_s_{seeds}", rate(seeds, "cpu", seconds=5.0).updates)
    torch.set_num_threads(threads)
