"""What the tests of ``train_agent`` share; what need not be killed runs in this process to save its start."""

import csv
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch
from rled_agent.cli import train_agent
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint
from rled_msgs_py.processes import program

WAIT_TIMEOUT = 120.0
ENDLESS = 10**9
SCHEDULE = {"train-after": 100, "train-every": 50, "gradient-steps": 10, "batch-size": 20, "log-every": 50}
SCHEDULE |= {"checkpoint-every": 100, "evaluate-every": 300, "evaluation-episodes": 2, "capacity": 500}
SMALL = [word for name, value in SCHEDULE.items() for word in (f"--schedule.{name}", str(value))]
SMALL += ["--learner.actor.hidden", "16", "16", "--learner.critic.hidden", "16", "16"]
PENDULUM = ["pendulum", "--random-steps", "30", *SMALL]


@pytest.fixture
def planar(planar_bag: Path, planar_expert: Path) -> list[str]:
    """Options of a small gated run on the planar robot, a quarter of each batch demonstrated."""
    return ["planar_mc_tuned", "--bag", str(planar_bag), "--expert", str(planar_expert), "--passes", "6", *SMALL]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Run the command in this process."""

    def run(options: list[str], output: Path, steps: int, *more: str) -> None:
        given = [*options, "--output", str(output), "--schedule.steps", str(steps), *more]
        monkeypatch.setattr(sys, "argv", ["train_agent", *given])
        train_agent.main()

    return run


@pytest.fixture
def train(command: Callable[..., None]) -> Callable[..., Checkpoint]:
    """Run the command in this process; returns the checkpoint that it ended with."""

    def run(options: list[str], output: Path, steps: int, *more: str) -> Checkpoint:
        command(options, output, steps, *more)
        return read_checkpoint(output / "checkpoint.safetensors")

    return run


@pytest.fixture
def refused(command: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run the command, which must end with code 2 and one line; returns the line."""

    def run(*arguments: object) -> str:
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            command(*arguments)
        lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("step ")]
        assert ended.value.code == 2
        assert len(lines) == 1
        assert lines[0].startswith("error: ")
        return lines[0]

    return run


@contextmanager
def started(options: list[str], output: Path, steps: int) -> Iterator["subprocess.Popen[str]"]:
    """The command as a process of its own."""
    command = [*program("rled_agent", "train_agent"), *options, "--output", str(output), "--schedule.steps", str(steps)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def await_step(process: "subprocess.Popen[str]", output: Path, step: int) -> None:
    """Wait until the checkpoint of a step, or a later one, has been written."""
    checkpoint, deadline = output / "checkpoint.safetensors", time.monotonic() + WAIT_TIMEOUT
    while not (checkpoint.exists() and read_checkpoint(checkpoint).state["run.step"] >= step):
        assert process.poll() is None, process.communicate()[0]
        assert time.monotonic() < deadline
        time.sleep(0.01)


def rows(output: Path) -> list[dict[str, float]]:
    with (output / "metrics.csv").open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def assert_same(one: Checkpoint, other: Checkpoint) -> None:
    assert one.state == other.state
    assert one.tensors.keys() == other.tensors.keys()
    for name, tensor in one.tensors.items():
        assert torch.equal(tensor, other.tensors[name]), name


def assert_same_figures(one: list[dict[str, float]], other: list[dict[str, float]]) -> None:
    assert len(one) == len(other)
    for left, right in zip(one, other, strict=True):
        names = {name for name in left if not name.endswith("_per_second")}
        assert {name: left[name] for name in names} == pytest.approx({name: right[name] for name in names}, nan_ok=True)
