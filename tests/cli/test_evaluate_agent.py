"""The command's table and files; it runs in this process to save its start."""

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rled_agent.cli import evaluate_agent
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.policy import Policy, load_policy
from rled_agent.training.evaluation import Score
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

BINS = ["seen", "2-5 cm away", "5-10 cm away"]
QUICK = ["--bins", "0.02", "0.05", "0.1", "--targets", "30", "--steps", "60"]


@pytest.fixture
def evaluate(monkeypatch: pytest.MonkeyPatch, planar_bag: Path, tmp_path: Path) -> Callable[..., Path]:
    """Run the command; returns its output folder."""

    def run(*options: object, bag: Path = planar_bag, output: Path = tmp_path / "out") -> Path:
        argv = ["evaluate_agent", "--bag", bag, "--output", output, *QUICK, *options]
        monkeypatch.setattr(sys, "argv", list(map(str, argv)))
        evaluate_agent.main()
        return output

    return run


@pytest.fixture
def refused(evaluate: Callable[..., Path], capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Callable[..., str]:
    """Run the command, which must end with code 2 and one line and write nothing; returns the line."""

    def run(*options: object, **others: Path) -> str:
        with pytest.raises(SystemExit) as ended:
            evaluate(*options, **others)
        (line,) = capsys.readouterr().err.splitlines()
        assert ended.value.code == 2
        assert not (tmp_path / "out").exists()
        return line

    return run


@pytest.fixture
def idle(planar_expert: Path, tmp_path: Path) -> Path:
    """A policy that hardly moves."""
    policy = load_policy(planar_expert)
    policy.network.load_vector(1e-3 * policy.network.vector())
    Policy(policy.network, policy.scaling, policy.task).save(tmp_path / "idle.safetensors")
    return tmp_path / "idle.safetensors"


def test_expert_and_agent_stand_side_by_side(evaluate, planar_expert, idle, capsys) -> None:
    output = evaluate("--expert", planar_expert, "--agent", idle)
    results = json.loads((output / "evaluation.json").read_text(), parse_constant=lambda text: pytest.fail(text))
    assert list(results) == BINS
    for group in results.values():
        assert list(group) == ["expert", "agent"]
        for score in group.values():
            assert tuple(score) == Score._fields
        assert group["expert"]["success"] > group["agent"]["success"]
        assert 1.0 <= group["expert"]["path_length"] < 2.0
        assert 1.0 <= group["expert"]["steps"] <= 60.0
        assert group["expert"]["jerk"] > group["agent"]["jerk"]
    assert results["seen"]["expert"]["success"] > 0.9
    pictures = {each.name for each in output.glob("*.png")}
    assert pictures == {"paths_seen.png", "paths_2-5_cm_away.png", "paths_5-10_cm_away.png"}
    assert all((output / name).read_bytes()[:4] == b"\x89PNG" for name in pictures)
    head, *lines, last = capsys.readouterr().out.splitlines()
    assert head.split() == ["targets", "policy", "success", "steps", "path/straight", "jerk", "m/s3", "violations"]
    for line, (group, name) in zip(
        lines, [(group, name) for group in BINS for name in ("expert", "agent")], strict=True
    ):
        assert line.startswith(group)
        assert line[16:].split()[0] == name
        figures = [math.nan if value is None else value for value in results[group][name].values()]
        np.testing.assert_allclose([float(figure) for figure in line[24:].split()], figures, rtol=1e-2)
    assert last == f"wrote {output}"


def test_whole_episodes_stand_below_the_bins(evaluate, planar_expert, idle, capsys) -> None:
    output = evaluate("--expert", planar_expert, "--agent", idle, "--episodes", 8, "--seed", 14)
    results = json.loads((output / "episodes.json").read_text())
    assert results["expert"]["targets_reached"] == 1.0
    # a policy that hardly moves is cut short, but where a target lies at its start: none does with this seed
    assert results["agent"] | {"reward": 0.0} == {
        "reward": 0.0,
        "steps": 100.0,
        "targets_reached": 0.0,
        "violations": 0.0,
    }
    head, *lines, _ = capsys.readouterr().out.splitlines()[-4:]
    assert head.split() == ["episodes", "return", "steps", "targets", "violations"]
    for line, (name, figures) in zip(lines, results.items(), strict=True):
        said, *rest = line.split()
        assert said == name
        np.testing.assert_allclose([float(figure) for figure in rest], list(figures.values()), rtol=1e-3)


def test_episodes_are_driven_behind_the_faults(evaluate, planar_expert, tmp_path) -> None:
    lost, late, same = (
        json.loads(
            (evaluate("--expert", planar_expert, "--episodes", 8, "--seed", 14, *options) / "episodes.json").read_text()
        )
        for options in (["--faults.command-loss", 1], *2 * [["--faults.control-delay", 2]])
    )
    # no displacement arrives: the robot stays
    assert (lost["expert"]["steps"], lost["expert"]["targets_reached"]) == (100.0, 0.0)
    assert late["expert"]["targets_reached"] > 0.5
    assert late["expert"]["steps"] > 3.0  # the first one arrives in the third step
    assert late == same


def test_the_help_says_what_a_fault_is(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["evaluate_agent", "--help"])
    with pytest.raises(SystemExit):
        evaluate_agent.main()
    words = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "--faults.command-loss FLOAT share of displacements that are lost: the robot stays. (default: 0.0)" in words


def test_the_same_seed_gives_the_same_results(evaluate, planar_expert, tmp_path) -> None:
    outputs = [
        evaluate("--expert", planar_expert, "--seed", seed, output=tmp_path / name)
        for name, seed in (("one", 1), ("same", 1), ("other", 2))
    ]
    one, same, other = ((output / "evaluation.json").read_bytes() for output in outputs)
    assert one == same
    assert one != other


def test_weights_of_another_robot_are_refused(refused, planar_expert, tmp_path) -> None:
    from rled_agent.nn.draws import Draws
    from rled_agent.nn.perceptron import Perceptron
    from rled_agent.nn.scaling import scaling_of_bounds

    task = reach_task(ROBOTS["panda"]).description
    limit = np.full(7, task.max_delta)
    network = Perceptron(10, 7, Architecture(hidden=(4,)), Draws([0]), squash=True)
    Policy(network, scaling_of_bounds(task.observation_bounds(), (-limit, limit)), task).save(tmp_path / "panda")
    for options in (["--expert", tmp_path / "panda"], ["--expert", planar_expert, "--agent", tmp_path / "panda"]):
        assert "is for robot panda; accepted: planar" in refused(*options)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--bins", "0.1", "0.05"], "bins (0.1, 0.05); accepted: two or more growing distances"),
        (["--bins", "0.1"], "bins (0.1,); accepted: two or more growing distances"),
        (["--targets", "0"], "targets is 0; accepted: 1 to "),
        (["--steps", "0"], "steps is 0; accepted: 1 to "),
        (["--seed", "-1"], "seed is -1; accepted: 0 to "),
        (["--episodes", "-1"], "episodes is -1; accepted: 0 to "),
        (["--faults.control-delay", "2"], "there are faults, and no episodes to have them in; give --episodes"),
        (["--episodes", "1", "--faults.hidden", "nose"], "hidden is 'nose'; accepted: "),
        (["--bins", "3", "3.00001", "--targets", "1"], "only 0 reachable targets 300-300.001 cm away; accepted: 1"),
        (["--bag", "/nowhere/bag"], "/nowhere/bag does not exist"),
        (["--agent", "/nowhere/policy"], "there is no /nowhere/policy"),
    ],
)
def test_what_cannot_be_evaluated_is_one_line(refused, planar_expert, options, what) -> None:
    assert what in refused("--expert", planar_expert, *options)
