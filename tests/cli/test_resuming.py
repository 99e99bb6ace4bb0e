"""Runs that go on: after a kill, a signal or a full disk, with the same settings and the same content of files."""

import json
import resource
import shutil
import signal
import subprocess

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from rled_agent.nn.policy import load_policy
from rled_agent.training.checkpoint import read_checkpoint
from rled_agent.training.run_directory import FILES
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.processes import program
from rled_msgs_py.topics import RECORDED

from .conftest import (
    ENDLESS,
    PENDULUM,
    SMALL,
    WAIT_TIMEOUT,
    assert_same,
    assert_same_figures,
    await_step,
    rows,
    started,
)


def test_a_killed_run_continues_to_the_same_state(train, planar, tmp_path) -> None:
    """SIGKILL at any moment: what the checkpoint says is what goes on, bit for bit."""
    output = tmp_path / "killed"
    with started(planar, output, ENDLESS) as process:
        await_step(process, output, 300)
    reached = read_checkpoint(output / "checkpoint.safetensors").state["run.step"]
    end = reached + 350
    resumed = train(planar, output, end, "--resume")
    assert_same(resumed, train(planar, tmp_path / "whole", end))
    assert_same_figures(rows(output), rows(tmp_path / "whole"))
    one, whole = (load_policy(each / "policy.safetensors").network.vector() for each in (output, tmp_path / "whole"))
    assert (one == whole).all()
    assert not [each for each in output.iterdir() if each.name.startswith(".")]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_with_a_checkpoint_that_continues(train, tmp_path, number) -> None:
    output = tmp_path / "stopped"
    with started(PENDULUM, output, ENDLESS) as process:
        await_step(process, output, 100)
        process.send_signal(number)
        said, _ = process.communicate(timeout=WAIT_TIMEOUT)
    assert process.returncode == 0
    reached = read_checkpoint(output / "checkpoint.safetensors").state["run.step"]
    assert f"{reached:,} of {ENDLESS:,} steps; the run is in {output}" in said
    assert "Traceback" not in said
    resumed = train(PENDULUM, output, reached + 130, "--resume")
    assert_same(resumed, train(PENDULUM, tmp_path / "whole", reached + 130))


def test_continuing_adds_rows_and_says_where(train, tmp_path, capsys) -> None:
    train(PENDULUM, tmp_path, 100)
    train(PENDULUM, tmp_path, 200, "--resume")
    assert "continuing at step 100" in capsys.readouterr().out
    assert [row["step"] for row in rows(tmp_path)] == [50, 100, 150, 200]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            ["--learner.gamma", "0.5"],
            "config.settings.learner.gamma changed since the run began; accepted: config.settings.learner.gamma ",
        ),
        (["--learner.actor.hidden", "16", "17"], "config.settings.learner.actor.hidden changed"),
        (["--env", "MountainCarContinuous-v0"], "config.env changed since the run began"),
        (["--seed", "3", "--schedule.batch-size", "21"], "config.seed, config.schedule.batch_size changed"),
    ],
)
def test_a_changed_setting_does_not_continue(train, refused, tmp_path, change, what) -> None:
    train(PENDULUM, tmp_path, 100)
    before = (tmp_path / "checkpoint.safetensors").read_bytes()
    assert what in refused(PENDULUM, tmp_path, 200, "--resume", *change)
    assert (tmp_path / "checkpoint.safetensors").read_bytes() == before


def test_a_run_of_a_version_with_other_settings_does_not_continue(train, refused, tmp_path) -> None:
    train(PENDULUM, tmp_path, 50)
    settings = tmp_path / "config.json"
    record = json.loads(settings.read_text())
    record["config"]["settings"]["former"] = record["config"]["settings"].pop("noise")
    settings.write_text(json.dumps(record))
    said = refused(PENDULUM, tmp_path, 100, "--resume")
    assert "begun by a version with other settings (config.settings.former, config.settings.noise); accepted: " in said


def test_there_is_nothing_to_continue(train, refused, tmp_path) -> None:
    assert "holds no run" in refused(PENDULUM, tmp_path, 100, "--resume")
    train(PENDULUM, tmp_path, 50)
    (tmp_path / "checkpoint.safetensors").unlink()
    assert f"the run in {tmp_path} has no checkpoint yet" in refused(PENDULUM, tmp_path, 100, "--resume")


def test_a_damaged_or_foreign_checkpoint_is_refused(train, refused, planar, tmp_path) -> None:
    train(PENDULUM, tmp_path / "run", 50)
    checkpoint = tmp_path / "run" / "checkpoint.safetensors"
    checkpoint.write_bytes(checkpoint.read_bytes()[:-10])
    assert f"{checkpoint} is damaged" in refused(PENDULUM, tmp_path / "run", 100, "--resume")
    train(planar, tmp_path / "other", 50)
    checkpoint.write_bytes((tmp_path / "other" / "checkpoint.safetensors").read_bytes())
    assert "the checkpoint: a replay of shape (1, 50, 13) after 50 steps; accepted: (1, 50, 10)" in refused(
        PENDULUM, tmp_path / "run", 100, "--resume"
    )


def test_a_copy_of_bag_and_expert_elsewhere_continues(train, planar, planar_bag, planar_expert, tmp_path) -> None:
    train(planar, tmp_path / "run", 100)
    bag, expert = shutil.copytree(planar_bag, tmp_path / "copy of the bag"), shutil.copy(planar_expert, tmp_path / "e")
    (mcap,) = bag.glob("*.mcap")
    for path in (bag, mcap):  # the bare file holds the same messages
        moved = [planar[0], "--bag", str(path), "--expert", str(expert), "--passes", "6", *SMALL]
        steps = 200 if path == bag else 300
        assert train(moved, tmp_path / "run", steps, "--resume").state["run.step"] == steps
    assert_same(read_checkpoint(tmp_path / "run/checkpoint.safetensors"), train(planar, tmp_path / "whole", 300))


def test_other_content_at_the_same_place_does_not_continue(train, refused, planar_bag, planar_expert, tmp_path) -> None:
    bag, expert = tmp_path / "bag", tmp_path / "expert.safetensors"
    shutil.copytree(planar_bag, bag)
    shutil.copy(planar_expert, expert)
    options = ["planar_mc_tuned", "--bag", str(bag), "--expert", str(expert), "--passes", "6", *SMALL]
    train(options, tmp_path / "run", 100)
    before = (tmp_path / "run/checkpoint.safetensors").read_bytes()
    policy = load_policy(expert)
    policy.network.load_vector(1.001 * policy.network.vector())
    policy.save(expert)
    said = refused(options, tmp_path / "run", 200, "--resume")
    assert f"what is in the expert {expert} has changed since the run began; accepted: its content of then; " in said
    assert "bring it back (a copy elsewhere will do), or begin a new run with another --output" in said
    shutil.copy(planar_expert, expert)
    shutil.rmtree(bag)
    source, topics = Bag(planar_bag), {topic.name: topic for topic in RECORDED}
    *messages, _ = source.messages()
    with BagWriter(bag) as writer:  # the last message is missing
        for each in messages:
            writer.write_cdr(topics[source.name_of(each)], each.data, each.log_time)
    assert f"what is in the bag {bag} has changed since the run began" in refused(
        options, tmp_path / "run", 200, "--resume"
    )
    elsewhere = [each if each != str(bag) else str(bag.rename(tmp_path / "moved")) for each in options]
    assert f"the bag {tmp_path / 'moved'} holds something else than the one that the run began with" in refused(
        elsewhere, tmp_path / "run", 200, "--resume"
    )
    assert (tmp_path / "run/checkpoint.safetensors").read_bytes() == before


def test_a_run_without_digests_is_one_of_another_version(train, refused, planar, tmp_path) -> None:
    train(planar, tmp_path, 50)
    record = json.loads((tmp_path / "config.json").read_text())
    del record["demonstrations"]["bag_sha256"]
    (tmp_path / "config.json").write_text(json.dumps(record))
    said = refused(planar, tmp_path, 100, "--resume")
    assert "was begun by a version with other settings (demonstrations.bag_sha256)" in said


METRICS = {
    "step,reward\n10": "is damaged in line 2",
    "step,reward\n10,1,2\n": "is damaged in line 2",
    "step,reward\nten,1\n": "is damaged in line 2",
    "reward\n1\n": "has no column step",
    "": "has no column step",
    "step\n\x00\n": "is damaged in line 2",
    'step\n"' + "1" * 200_000: "cannot be read",
}
CONFIGS = [
    "[]",
    "3",
    "null",
    '"config"',
    "{}",
    '{"config": []}',
    '{"config": {}, "demonstrations": 3}',
    "{",
    "[" * 10**5,
]


def test_a_run_folder_with_garbled_files_is_one_line(train, refused, tmp_path) -> None:
    train(PENDULUM, tmp_path, 100)
    metrics, config = tmp_path / "metrics.csv", tmp_path / "config.json"
    whole = metrics.read_text()
    for text, said in METRICS.items():
        metrics.write_text(text)
        assert f"{metrics} {said}" in refused(PENDULUM, tmp_path, 200, "--resume")
    metrics.write_bytes(b"step\n\xff\n")
    assert "UTF-8" in refused(PENDULUM, tmp_path, 200, "--resume")
    metrics.write_text(whole)
    settings = config.read_text()
    for text in CONFIGS:
        config.write_text(text)
        said = refused(PENDULUM, tmp_path, 200, "--resume")
        assert any(each in said for each in ("holds no run", "holds no settings", "begun by a version with other"))
    config.write_text(settings)
    assert train(PENDULUM, tmp_path, 200, "--resume").state["run.step"] == 200


class Arm(gymnasium.Env):
    """Cannot be brought to where it was; counts what all of its kind are asked for."""

    is_repeatable = False
    observation_space = gymnasium.spaces.Box(-1, 1, (3,))
    action_space = gymnasium.spaces.Box(-1, 1, (2,))
    resets = steps = 0

    def reset(self, *, seed=None, options=None):
        Arm.resets += 1
        return np.zeros(3, np.float32), {}

    def step(self, action):
        Arm.steps += 1
        return np.zeros(3, np.float32), -1.0, False, False, {}


def test_a_run_on_an_arm_goes_on_with_a_new_episode_and_makes_no_motion_again(
    train, tmp_path, capsys, monkeypatch
) -> None:
    monkeypatch.setitem(gymnasium.registry, "Arm-v0", EnvSpec("Arm-v0", entry_point=Arm, disable_env_checker=True))
    options = ["td3", "--env", "Arm-v0", "--reward", "own", *SMALL]
    train(options, tmp_path, 150)
    capsys.readouterr()
    Arm.resets = Arm.steps = 0
    assert train(options, tmp_path, 200, "--resume").state["run.step"] == 200
    assert "continuing at step 150, with a new episode" in capsys.readouterr().out
    assert (Arm.steps, Arm.resets) == (50, 2)  # one as the run is made, one as it goes on; there is no evaluation
    assert [row["step"] for row in rows(tmp_path)] == [50, 100, 150, 200]


def test_a_full_disk_is_one_line_and_the_last_good_checkpoint_continues(train, tmp_path) -> None:
    """A limit on the size of files stands for the disk: the replay, and with it the checkpoint, grows beyond it."""
    output = tmp_path / "run"
    size = 40_000
    command = [*program("rled_agent", "train_agent"), *PENDULUM, "--output", str(output), "--schedule.steps", "1000"]
    command += ["--schedule.capacity", "100000"]

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_TIMEOUT, preexec_fn=limit)
    assert done.returncode == 2, done.stderr
    lines = [line for line in done.stderr.splitlines() if not line.startswith("step ")]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith(f"error: can't write {output / 'checkpoint.safetensors'}")
    kept = read_checkpoint(output / "checkpoint.safetensors").state["run.step"]
    assert 0 < kept < 1000
    assert {each.name for each in output.iterdir() if "tfevents" not in each.name} <= {*FILES}
    more = ["--schedule.capacity", "100000"]
    resumed = train(PENDULUM, output, kept + 100, "--resume", *more)
    assert_same(resumed, train(PENDULUM, tmp_path / "whole", kept + 100, *more))
