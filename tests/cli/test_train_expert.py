"""The command, with options as a person types them; what it refuses runs in this process to save its start."""

import csv
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rled_agent.cli import train_expert
from rled_agent.data.closed_form import joined_points
from rled_agent.nn.policy import load_policy
from rled_msgs_py.bags import Bag
from rled_msgs_py.processes import program

QUICK = ["--steps", "60", "--validate-every", "20", "--architecture.hidden", "16", "16", "--batch-size", "32"]
FILES = {"expert.safetensors", "curve.csv", "learning_curve.png", "summary.json"}


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run the command, which must end with code 2 and one line; returns the line."""

    def run(*arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", ["train_expert", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            train_expert.main()
        lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error")]
        assert ended.value.code == 2
        assert len(lines) == 1
        return lines[0]

    return run


def test_a_bag_becomes_weights_curve_picture_and_summary(planar_bag: Path, tmp_path: Path) -> None:
    command = [*program("rled_agent", "train_expert"), "--bag", str(planar_bag), "--seed", "3", *QUICK]
    done = subprocess.run([*command, "--output", str(tmp_path / "one")], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert {each.name for each in (tmp_path / "one").iterdir()} == FILES
    summary = json.loads((tmp_path / "one" / "summary.json").read_text())
    with (tmp_path / "one" / "curve.csv").open(newline="") as file:
        curve = list(csv.DictReader(file))
    assert [int(point["step"]) for point in curve] == [20, 40, 60]
    assert float(curve[-1]["validation"]) == summary["expert_val_mse"]
    assert summary["transitions"] == len(joined_points(Bag(planar_bag)))
    assert (summary["bag"], summary["source"], summary["seed"]) == (str(planar_bag), "points", 3)
    assert f"{summary['transitions']:,} demonstrated transitions of robot planar" in done.stdout
    assert (tmp_path / "one" / "learning_curve.png").read_bytes()[:4] == b"\x89PNG"
    policy = load_policy(tmp_path / "one" / "expert.safetensors")
    assert policy.network.architecture.hidden == (16, 16)
    assert np.abs(policy.act(np.zeros((1, 4)))).max() <= policy.task.max_delta


@pytest.mark.parametrize("source", ["points", "trajectories"])
def test_the_same_seed_gives_the_same_files(planar_bag, tmp_path, monkeypatch, source) -> None:
    for name in ("one", "same"):
        argv = ["train_expert", "--bag", str(planar_bag), "--source", source, "--output", str(tmp_path / name), *QUICK]
        monkeypatch.setattr(sys, "argv", argv)
        train_expert.main()
    for name in FILES - {"learning_curve.png"}:
        one, same = ((tmp_path / run / name).read_bytes() for run in ("one", "same"))
        assert one == same, name


def test_a_missing_bag_is_one_line_and_nothing_is_written(refused, tmp_path) -> None:
    assert "gone does not exist" in refused("--bag", tmp_path / "gone", "--output", tmp_path / "out", *QUICK)
    assert not (tmp_path / "out").exists()


def test_a_truncated_bag_is_one_line_and_nothing_is_written(refused, planar_bag, tmp_path) -> None:
    (mcap,) = planar_bag.glob("*.mcap")
    (tmp_path / "cut.mcap").write_bytes(mcap.read_bytes()[:-1000])
    assert "cut.mcap" in refused("--bag", tmp_path / "cut.mcap", "--output", tmp_path / "out", *QUICK)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--steps", "0"], "error: steps is 0; accepted: 1 to "),
        (["--seed", "-1"], "error: seed is -1; accepted: 0 to "),
        (["--architecture.hidden", "0"], "error: architecture.hidden is (0,); accepted: 1 to "),
        (["--validation-share", "0"], "error: too few demonstrated trajectories"),
        (["--validation-share", "1"], "error: too few demonstrated trajectories"),
    ],
)
def test_settings_out_of_range_are_one_line(refused, planar_bag, tmp_path, options, what) -> None:
    assert refused("--bag", planar_bag, "--output", tmp_path / "out", *options).startswith(what)
    assert not (tmp_path / "out").exists()


def test_an_output_that_cannot_be_written_is_one_line(refused, planar_bag, tmp_path) -> None:
    (tmp_path / "file").touch()
    assert "is no folder; accepted: a folder for the results; name another folder with --output" in refused(
        "--bag", planar_bag, "--output", tmp_path / "file" / "out", *QUICK
    )
