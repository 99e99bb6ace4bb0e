"""The worked example of docs/adding.md: the method printed there, added as one file, trains, resumes and drives."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from rled_agent.deploy.piloting import Pilot, StrategySettings, load_policies
from rled_agent.nn.policy import GateSettings, load_policy
from rled_agent.training.checkpoint import read_checkpoint
from rled_msgs_py.records import Actor

ROOT = Path(__file__).parents[2]
NAME = "disagreement_gate"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the file of the documentation and nothing else."""
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/adding.md").read_text(), re.DOTALL)
    assert len(code.splitlines()) <= 120
    folder = tmp_path_factory.mktemp("methods")
    (folder / f"{NAME}.py").write_text(code)
    return folder


def train_agent(folder: Path, *arguments: object) -> str:
    """The command, with that folder beside the package's own methods."""
    program = "import sys, rled_agent.methods as m; m.__path__.append(sys.argv.pop(1)); "
    program += "from rled_agent.cli.train_agent import main; main()"
    command = [sys.executable, "-c", program, str(folder), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_method_in_one_file_is_listed_and_explains_itself(folder: Path) -> None:
    assert f"{NAME} " in train_agent(folder, "--list")
    said = train_agent(folder, NAME, "--help")
    assert "nobody's yet" in said
    assert "--steps" in said
    assert "Needs: expert." in said


def test_it_trains_resumes_bit_for_bit_and_drives_by_its_gate(
    folder: Path, tmp_path: Path, planar_bag: Path, planar_expert: Path
) -> None:
    options = [NAME, "--env", "rled/PlanarReach-v0", "--reward", "dense", "--bag", planar_bag]
    options += ["--expert", planar_expert, "--schedule.train-after", 100, "--schedule.log-every", 150]
    options += ["--schedule.evaluate-every", 300, "--schedule.evaluation-episodes", 2]
    options += ["--schedule.checkpoint-every", 150]
    train_agent(folder, *options, "--schedule.steps", 300, "--output", tmp_path / "whole")
    train_agent(folder, *options, "--schedule.steps", 151, "--output", tmp_path / "halves")
    train_agent(folder, *options, "--schedule.steps", 300, "--output", tmp_path / "halves", "--resume")
    whole, halves = (load_policy(tmp_path / run / "policy.safetensors") for run in ("whole", "halves"))
    assert (whole.network.vector() == halves.network.vector()).all()
    assert whole.origin.method == NAME
    assert whole.origin.gate == GateSettings("std", 0.5, estimator="critics")
    assert whole.critic is not None
    assert whole.critic.ensemble == 5
    policies = load_policies(str(planar_expert), str(tmp_path / "whole"))
    observation = sum(whole.task.observation_bounds()) / 2.0
    for threshold, actor in ((1e9, Actor.AGENT), (0.0, Actor.EXPERT)):
        gate = GateSettings("std", threshold, estimator="critics")
        pilot = Pilot(policies, StrategySettings(gate), seed=0)
        pilot.begin()
        assert pilot.propose(observation).actor is actor


def test_seeds_and_a_sweep_of_it_are_the_same_as_alone(folder: Path, tmp_path: Path, planar_expert: Path) -> None:
    options = [NAME, "--env", "rled/PlanarReach-v0", "--expert", planar_expert, "--schedule.train-after", 60]
    options += ["--schedule.log-every", 120, "--schedule.evaluate-every", 240, "--schedule.checkpoint-every", 120]
    options += ["--schedule.steps", 120]
    train_agent(folder, *options, "--seeds", "0-1", "--sweep", "threshold=0.3,0.0", "--output", tmp_path / "runs")
    train_agent(folder, *options, "--threshold", 0.3, "--seed", 1, "--output", tmp_path / "alone")
    one, alone = (
        read_checkpoint(tmp_path / run / "checkpoint.safetensors") for run in ("runs/threshold-0.3/seed-1", "alone")
    )
    assert one.state == alone.state
    assert all(torch.equal(tensor, one.tensors[name]) for name, tensor in alone.tensors.items())
    assert load_policy(tmp_path / "runs/threshold-0.0/seed-0").origin.gate.threshold == 0.0
