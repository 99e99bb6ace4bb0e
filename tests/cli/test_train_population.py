"""Several seeds and swept numbers by one command: each run as alone, in a folder of its own."""

import json
import shutil
import signal
from pathlib import Path

import pytest
from rled_agent.nn.policy import load_policy
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint

from .conftest import ENDLESS, PENDULUM, WAIT_TIMEOUT, assert_same, assert_same_figures, await_step, rows, started


def checkpoint(folder: Path) -> Checkpoint:
    return read_checkpoint(folder / "checkpoint.safetensors")


@pytest.fixture
def experts(planar_expert: Path, tmp_path: Path) -> Path:
    """An expert for each of the seeds 0 to 2, as a path with {seed} in it."""
    policy = load_policy(planar_expert)
    vector = policy.network.vector()
    for seed in range(3):
        policy.network.load_vector(vector * (1.0 + 0.01 * seed))
        policy.save(tmp_path / f"expert-{seed}" / "expert.safetensors")
    return tmp_path / "expert-{seed}"


def test_each_seed_is_the_run_of_that_seed_with_its_own_expert(command, train, planar, experts, tmp_path, capsys):
    options = [each if not each.endswith("expert.safetensors") else str(experts) for each in planar]
    command(options, tmp_path / "runs", 320, "--seeds", "0-2")
    said = capsys.readouterr()
    assert f"320 of 320 steps; 3 runs are in {tmp_path / 'runs'}" in said.out
    assert said.err.splitlines()[-1].startswith("step 320 of 320: updates/s ")
    assert " in all" in said.err.splitlines()[-1]
    digests = set()
    for seed in range(3):
        one, alone = tmp_path / f"runs/seed-{seed}", tmp_path / f"alone-{seed}"
        kept = train(options, alone, 320, "--seed", str(seed))
        assert_same(checkpoint(one), kept)
        assert_same_figures(rows(one), rows(alone))
        record, same = (json.loads((each / "config.json").read_text()) for each in (one, alone))
        assert record == same
        assert record["config"]["seed"] == seed
        assert record["demonstrations"]["expert"] == str(tmp_path / f"expert-{seed}")
        digests.add(record["demonstrations"]["expert_sha256"])
        assert json.loads((one / "expert.json").read_text()) == json.loads((alone / "expert.json").read_text())
        for name in ("policy", "best"):
            left, right = (load_policy(each / f"{name}.safetensors").network.vector() for each in (one, alone))
            assert (left == right).all()
    assert len(digests) == 3


def test_a_sweep_is_a_run_for_each_value(command, train, tmp_path):
    command(PENDULUM, tmp_path / "runs", 150, "--seeds", "1,4", "--sweep", "noise=0,0.3")
    for noise in ("0", "0.3"):
        for seed in ("1", "4"):
            alone = train(PENDULUM, tmp_path / f"{noise}-{seed}", 150, "--seed", seed, "--noise", noise)
            assert_same(checkpoint(tmp_path / f"runs/noise-{noise}/seed-{seed}"), alone)


def test_a_stopped_population_goes_on_to_the_same_state(command, tmp_path, capsys):
    options, output = [*PENDULUM, "--seeds", "0-2"], tmp_path / "runs"
    with started(options, output, ENDLESS) as process:
        await_step(process, output / "seed-2", 100)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=WAIT_TIMEOUT)
    assert process.returncode == 0
    reached = checkpoint(output / "seed-0").state["run.step"]
    assert {checkpoint(output / f"seed-{seed}").state["run.step"] for seed in range(3)} == {reached}
    capsys.readouterr()
    command(options, output, reached + 110, "--resume")
    assert f"continuing 3 runs at step {reached:,}" in capsys.readouterr().out
    command(options, tmp_path / "whole", reached + 110)
    for seed in range(3):
        assert_same(checkpoint(output / f"seed-{seed}"), checkpoint(tmp_path / f"whole/seed-{seed}"))


def test_runs_that_a_kill_left_at_several_steps_go_on(command, tmp_path, capsys):
    options, output = [*PENDULUM, "--seeds", "0-2"], tmp_path / "runs"
    command(options, output, 100)
    shutil.copytree(output / "seed-1", tmp_path / "earlier")
    command(options, output, 200, "--resume")
    shutil.rmtree(output / "seed-1")
    (tmp_path / "earlier").rename(output / "seed-1")  # as if it had been killed before it saved this one
    capsys.readouterr()
    command(options, output, 260, "--resume")
    said = capsys.readouterr().out
    assert "continuing at step 100" in said
    assert "continuing 2 runs at step 200" in said
    command(options, tmp_path / "whole", 260)
    for seed in range(3):
        assert_same(checkpoint(output / f"seed-{seed}"), checkpoint(tmp_path / f"whole/seed-{seed}"))
        assert_same_figures(rows(output / f"seed-{seed}"), rows(tmp_path / f"whole/seed-{seed}"))


def test_a_run_that_has_diverged_stays_as_it_is_when_the_others_go_on(command, refused, tmp_path):
    options, output = [*PENDULUM, "--seeds", "0-2"], tmp_path / "runs"
    command(options, output, 100)
    (output / "seed-1/diverged.json").write_text('{"step": 100}\n')
    (output / "seed-1/checkpoint.safetensors").unlink()  # it may have ended before it saved one
    command(options, output, 150, "--resume")
    assert [checkpoint(output / f"seed-{seed}").state["run.step"] for seed in (0, 2)] == [150, 150]
    assert [row["step"] for row in rows(output / "seed-1")] == [50, 100]
    for seed in (0, 2):
        (output / f"seed-{seed}/diverged.json").write_text('{"step": 150}\n')
    said = refused(options, output, 200, "--resume")
    assert said == "error: all 3 runs have diverged; begin new ones with another --output"


def test_no_run_begins_where_one_of_them_cannot(refused, command, tmp_path):
    command(PENDULUM, tmp_path / "runs/seed-1", 50, "--seed", "1")
    said = refused(PENDULUM, tmp_path / "runs", 50, "--seeds", "0-2")
    assert f"{tmp_path / 'runs/seed-1'} holds a run already" in said
    assert not (tmp_path / "runs/seed-0").exists()


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--seeds", "a"], "seeds are 'a'; accepted: numbers and ranges, as 0-7 or 0,2,5"),
        (["--sweep", "psi=0"], "no number 'psi' to sweep; accepted: noise, learner.gamma"),
        (["--sweep", "noise=11"], "--sweep noise=11: noise is 11.0; accepted: 0 to 10"),
        (["--seeds", "0-1", "--over", "graph"], "2 runs over one graph; accepted: one; leave out --seeds and --sweep"),
        (["--device", "nowhere"], "nowhere"),
        (["--seeds", "0-1", "--expert", "/nowhere/{seed}"], "there is no /nowhere/0"),
    ],
)
def test_what_cannot_be_made_together_is_one_line_and_nothing_is_written(refused, tmp_path, options, what):
    assert what in refused(PENDULUM, tmp_path / "run", 100, *options)
    assert not (tmp_path / "run").exists()
