"""A learner of Stable-Baselines3 on this project's tasks; it runs in this process to save its start."""

import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rled_agent.cli import train_baseline
from rled_agent.cli.train_baseline import Scaled
from rled_agent.methods.td3 import TD3
from rled_agent.nn.scaling import Scaling
from rled_agent.training.config import TrainConfig
from rled_agent.training.environments import make_environment

QUICK = [
    "--env",
    "rled/PlanarReach-v0",
    "--steps",
    "300",
    "--train-after",
    "50",
    "--batch-size",
    "20",
    "--evaluate-every",
    "100",
]


@pytest.fixture
def train(monkeypatch: pytest.MonkeyPatch, planar_bag: Path, tmp_path: Path) -> Callable[..., Path]:
    """Run the command; returns the folder of the run."""

    def run(name: str, *options: object) -> Path:
        given = ["--bag", planar_bag, "--output", tmp_path / name, "--evaluation-episodes", 2, *QUICK, *options]
        monkeypatch.setattr(sys, "argv", ["train_baseline", *map(str, given)])
        train_baseline.main()
        return tmp_path / name

    return run


@pytest.mark.parametrize("algorithm", ["td3", "sac"])
def test_a_baselines_run_has_settings_and_evaluations(train, algorithm) -> None:
    folder = train("run", "--algorithm", algorithm, "--gamma", 0.9)
    rows = list(csv.DictReader((folder / "metrics.csv").open()))
    assert [float(row["step"]) for row in rows] == [100.0, 200.0, 300.0]
    assert all(1.0 <= float(row["evaluation_steps"]) <= 100.0 for row in rows)
    assert all(0.0 <= float(row["evaluation_targets_reached"]) <= 1.0 for row in rows)
    settings = json.loads((folder / "config.json").read_text())["config"]
    assert (settings["algorithm"], settings["gamma"], settings["seed"]) == (algorithm, 0.9, 0)


def test_the_same_seed_gives_the_same_baseline(train) -> None:
    one, same, other, paid = (
        (train(name, *options) / "metrics.csv").read_bytes()
        for name, options in (
            ("one", []),
            ("same", []),
            ("other", ["--seed", 1]),
            ("paid", ["--reward-scale", 100]),
        )
    )
    assert one == same
    assert one not in (other, paid)


def test_a_baseline_sees_what_this_projects_networks_see() -> None:
    env = make_environment(TrainConfig(TD3(), env="rled/PlanarReach-v0"), None)
    center, scale = np.array([1.0, 2.0, 3.0, 4.0]), np.array([2.0, 4.0, 8.0, 16.0])
    scaled = Scaled(env, Scaling(center, scale, np.zeros(2), np.full(2, 0.05)), reward_scale=0.5)
    plain = make_environment(TrainConfig(TD3(), env="rled/PlanarReach-v0"), None)
    np.testing.assert_allclose(scaled.reset(seed=3)[0], (plain.reset(seed=3)[0] - center) / scale, rtol=1e-5)
    observation, reward, *_ = scaled.step(np.array([0.5, -1.0]))
    expected, paid, *_ = plain.step(np.array([0.025, -0.05]))
    np.testing.assert_allclose(observation, (expected - center) / scale, rtol=1e-5)
    assert reward == pytest.approx(0.5 * paid)
    env.close()
    plain.close()


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--gamma", "2"], "gamma is 2.0; accepted: 0 to 1"),
        (["--env", "Pendulum-v1"], "env 'Pendulum-v1' takes no"),
        (["--bag", "/nowhere/bag"], "/nowhere/bag does not exist"),
    ],
)
def test_what_a_baseline_cannot_learn_is_one_line(train, capsys, options, what) -> None:
    with pytest.raises(SystemExit) as ended:
        train("run", *options)
    (line,) = capsys.readouterr().err.splitlines()
    assert ended.value.code == 2
    assert what in line
