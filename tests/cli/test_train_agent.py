"""The command, with options as a person types them; what need not be killed runs in this process to save its start."""

import csv
import hashlib
import json
import math
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.envs.registration import EnvSpec
from rled_agent.cli import train_agent
from rled_agent.cli.presets import PRESETS
from rled_agent.methods import all_methods
from rled_agent.nn.policy import load_policy
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint
from rled_agent.training.digests import bag_digest
from rled_agent.training.trainer import Trainer
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.processes import Children, program
from rled_msgs_py.topics import RECORDED

WAIT_TIMEOUT = 120.0
ENDLESS = 10**9
SCHEDULE = {"train-after": 100, "train-every": 50, "gradient-steps": 10, "batch-size": 20, "log-every": 50}
SCHEDULE |= {"checkpoint-every": 100, "evaluate-every": 300, "evaluation-episodes": 2, "capacity": 500}
SMALL = [word for name, value in SCHEDULE.items() for word in (f"--schedule.{name}", str(value))]
SMALL += ["--learner.actor.hidden", "16", "16", "--learner.critic.hidden", "16", "16"]
PENDULUM = ["pendulum", "--random-steps", "30", *SMALL]
FILES = {
    "expert.json", "checkpoint.safetensors", "config.json", "metrics.csv", "policy.safetensors", "best.safetensors"
}  # fmt: skip


@pytest.fixture
def planar(planar_bag: Path, planar_expert: Path) -> list[str]:
    """Options of a small gated run on the planar robot, a quarter of each batch demonstrated."""
    return ["planar_mc_tuned", "--bag", str(planar_bag), "--expert", str(planar_expert), "--passes", "6", *SMALL]


@pytest.fixture
def train(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Checkpoint]:
    """Run the command in this process; returns the checkpoint that it ended with."""

    def run(options: list[str], output: Path, steps: int, *more: str) -> Checkpoint:
        given = [*options, "--output", str(output), "--schedule.steps", str(steps), *more]
        monkeypatch.setattr(sys, "argv", ["train_agent", *given])
        train_agent.main()
        return read_checkpoint(output / "checkpoint.safetensors")

    return run


@pytest.fixture
def refused(train: Callable[..., Checkpoint], capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run the command, which must end with code 2 and one line; returns the line."""

    def run(*arguments: object) -> str:
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            train(*arguments)
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


def test_a_run_is_a_directory(train, planar, planar_bag, planar_expert, tmp_path, capsys) -> None:
    output = tmp_path / "run"
    checkpoint = train(planar, output, 620)
    assert checkpoint.state["run.step"] == 620
    assert checkpoint.state["learner.updates"] == 10 * 11  # due at steps 100, 150, ..., 600
    files = {each.name for each in output.iterdir()}
    assert files > FILES
    assert len(files - FILES) == 1
    assert (files - FILES).pop().startswith("events.out.tfevents")
    record = json.loads((output / "config.json").read_text())
    assert record["config"]["method"] == "mc_rled"
    assert record["config"]["settings"]["learner"]["actor"]["hidden"] == [16, 16]
    assert record["config"]["settings"]["cloning"] == {"weight": 3.0, "q_filter": False}
    files = {"bag": str(planar_bag), "expert": str(planar_expert)}
    flawless = {"tremor": 0.0, "wrong": 0.0, "seed": 0}
    digest = hashlib.sha256(planar_expert.read_bytes()).hexdigest()
    files |= {"bag_sha256": bag_digest(Bag(planar_bag)), "expert_sha256": digest, "simulation": None}
    assert record["demonstrations"] == files | {
        "source": "points",
        "min_quality": 0.0,
        "points": 0,
        "corruption": flawless,
        "over": "process",
    }
    assert {"git", "python", "torch"} < record.keys()
    table = rows(output)
    assert [row["step"] for row in table] == [*range(50, 601, 50), 620]
    assert [row["updates"] for row in table][:4] == [0, 0, 10, 20]  # those due at a step are made during the next
    assert [row["step"] for row in table if math.isfinite(row["evaluation_reward"])] == [300, 600]
    assert all(0.0 <= row["demonstrated_share"] <= 1.0 for row in table)
    assert all(row["qcd_mean"] > 0.0 and row["iqr_mean"] > 0.0 for row in table)
    policy = load_policy(output / "policy.safetensors")
    assert torch.equal(policy.network.weights[0], checkpoint.tensors["learner.actor.weights.0"])
    assert policy.task.robot == "planar"
    said = capsys.readouterr()
    assert f"620 of 620 steps; the run is in {output}" in said.out
    assert said.err.splitlines()[-1].startswith("step 620 of 620: updates/s ")


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


def test_the_same_seed_gives_the_same_run_and_another_seed_another(train, tmp_path) -> None:
    one, same = (train(PENDULUM, tmp_path / name, 150) for name in ("one", "same"))
    assert_same(one, same)
    other = train(PENDULUM, tmp_path / "other", 150, "--seed", "1")
    assert not torch.equal(one.tensors["learner.actor.weights.0"], other.tensors["learner.actor.weights.0"])


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


def test_a_folder_with_a_run_is_not_overwritten(train, refused, tmp_path) -> None:
    train(PENDULUM, tmp_path, 50)
    assert "holds a run already" in refused(PENDULUM, tmp_path, 50)


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
    assert "the checkpoint: a replay of shape (50, 13) after 50 steps; accepted: (500, 10)" in refused(
        PENDULUM, tmp_path / "run", 100, "--resume"
    )


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--env", "CartPole-v1"], "td3 cannot serve the action space Discrete(2); accepted: a Box of one dimension"),
        (["--env", "NoSuch-v0"], "env 'NoSuch-v0'"),
        (["--noise", "11"], "noise is 11.0; accepted: 0 to 10"),
        (["--learner.gamma", "1.5"], "learner.gamma is 1.5; accepted: 0 to 1"),
        (["--learner.critic.dropout", "0.5"], "learner.critic.dropout is 0.5; accepted: 0; critics drop no units"),
        (["--schedule.checkpoint-every", "70"], "schedule.checkpoint_every is 70; accepted: a multiple of"),
        (["--seed", "-1"], "seed is -1; accepted: 0 to "),
        (["--bag", "/nowhere/bag"], "/nowhere/bag does not exist"),
        (["--reward", "sparse"], "env 'Pendulum-v1' takes no reward"),
    ],
)
def test_what_cannot_be_learned_is_one_line_and_nothing_is_written(refused, tmp_path, options, what) -> None:
    assert what in refused(PENDULUM, tmp_path / "run", 100, *options)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", [name for name, method in all_methods().items() if method.needs])
def test_a_method_that_lacks_what_it_needs_is_one_line_and_nothing_is_written(refused, tmp_path, name) -> None:
    said = refused([name], tmp_path / "run", 100)
    lacking = " and ".join(all_methods()[name].needs)
    assert said == (
        f"error: {name} lacks {lacking}; accepted: --bag and --expert; "
        "record a bag with record_demos, clone it with train_expert"
    )
    assert not (tmp_path / "run").exists()


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """What the command prints for help."""

    def run(*arguments: str) -> str:
        monkeypatch.setenv("COLUMNS", "200")
        monkeypatch.setattr(sys, "argv", ["train_agent", *arguments])
        with suppress(SystemExit):
            train_agent.main()
        return capsys.readouterr().out

    return run


def test_all_presets_and_methods_stand_in_one_table_with_their_papers(said) -> None:
    table = said("--list")
    lines = {line.split()[0]: line for line in table.splitlines() if line}
    assert set(lines) == {"preset", "method", *PRESETS, *all_methods()}
    for name, method in all_methods().items():
        needed = ", ".join(method.needs) or "-"
        assert lines[name].split(maxsplit=1)[1].startswith(needed)
        assert lines[name].endswith(f"{method.title} ({method.paper})")
    for name, preset in PRESETS.items():
        assert lines[name].split(maxsplit=2)[1:] == [preset.config.method.name, preset.summary]
    for nothing in ((), ("--help",), ("-h",)):
        helped = said(*nothing)
        assert helped.startswith("usage: train_agent NAME")
        assert table in helped


@pytest.mark.parametrize("name", all_methods())
def test_the_help_of_a_method_names_its_paper_and_what_it_needs(said, name) -> None:
    method, words = all_methods()[name], " ".join(said(name, "--help").replace("│", " ").split())
    assert method.paper in words
    for need in method.needs:
        assert need in words
    assert "--schedule.steps" in words
    assert "--learner.gamma" in words


@pytest.mark.parametrize(
    ("typed", "near"),
    [("ddgp", "ddpg"), ("mc_relly", "mc_rled"), ("planar-mc", "planar_mc"), ("biased", "biased_exploration")],
)
def test_the_nearest_names_are_said_for_one_that_there_is_not(refused, tmp_path, typed, near) -> None:
    line = refused([typed], tmp_path / "run", 1)
    assert line.startswith(f"error: no preset or method '{typed}'; accepted: ")
    assert near in line.split("did you mean ")[1].split("?")[0].split(" or ")
    assert line.endswith("? see what they are: train_agent --list")


@pytest.mark.parametrize(
    ("typed", "what"),
    [("xyzzy", "no preset or method 'xyzzy'"), ("--bag", "no preset or method is named before --bag")],
)
def test_a_name_like_none_is_answered_with_all_of_them(refused, tmp_path, typed, what) -> None:
    line = refused([typed], tmp_path / "run", 1)
    assert line.startswith(f"error: {what}; accepted: ")
    assert all(name in line for name in (*PRESETS, *all_methods()))


def test_recorded_motions_are_learned_from(train, planar_bag, planar_expert, tmp_path) -> None:
    options = ["q_filtered_cloning", "--env", "rled/PlanarReach-v0", "--bag", str(planar_bag), *SMALL]
    recorded = train([*options, "--source", "trajectories"], tmp_path / "run", 150)
    joined = train(options, tmp_path / "joined", 150)
    assert recorded.state["learner.updates"] == joined.state["learner.updates"] == 10
    assert not torch.equal(recorded.tensors["learner.actor.weights.0"], joined.tensors["learner.actor.weights.0"])
    record = json.loads((tmp_path / "run/config.json").read_text())
    assert record["demonstrations"]["source"] == "trajectories"
    assert "demonstrated_share" not in rows(tmp_path / "run")[-1]  # no expert could have acted


def test_a_bag_or_an_expert_of_another_robot_is_refused(refused, planar, tmp_path) -> None:
    for options, what in (
        (
            ["--env", "rled/PandaReach-v0"],
            "is of robot planar, env rled/PandaReach-v0 of panda; accepted: a bag of panda",
        ),
        (["--expert", str(tmp_path / "gone")], "there is no "),
    ):
        assert what in refused(planar, tmp_path / "run", 100, *options)
    assert not (tmp_path / "run").exists()


def test_a_preset_of_another_robot_names_the_environment_that_the_bag_is_for(
    train, refused, planar, planar_bag, tmp_path
) -> None:
    options = ["panda_tuned", *planar[1:]]
    said = refused(options, tmp_path / "run", 100)
    assert said == (
        f"error: bag {planar_bag} is of robot planar, env rled/PandaReach-v0 of panda; accepted: a bag of panda; "
        "or --env rled/PlanarReach-v0"
    )
    assert train([*options, *said.split("; or ")[1].split()], tmp_path / "run", 50).state["run.step"] == 50


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


def test_a_loss_that_is_no_number_names_the_step_and_the_last_good_checkpoint(refused, monkeypatch, tmp_path) -> None:
    update = Trainer.advance

    def poisoned(trainer) -> None:
        if trainer.step == 140:
            trainer.learning.replay.rows[:, 4] = np.nan  # rewards, as an environment that breaks would pay
        update(trainer)

    monkeypatch.setattr(Trainer, "advance", poisoned)
    line = refused(PENDULUM, tmp_path, 300)
    assert "no number at step 150" in line
    assert line.endswith(f"the last good checkpoint is {tmp_path / 'checkpoint.safetensors'}")
    assert read_checkpoint(tmp_path / "checkpoint.safetensors").state["run.step"] == 100


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
    assert {each.name for each in output.iterdir() if "tfevents" not in each.name} <= FILES
    more = ["--schedule.capacity", "100000"]
    resumed = train(PENDULUM, output, kept + 100, "--resume", *more)
    assert_same(resumed, train(PENDULUM, tmp_path / "whole", kept + 100, *more))


def test_training_over_the_graph_is_training_in_process(train, refused, planar, planar_bag, tmp_path) -> None:
    with Children() as children:
        command = [*program("rled_sim", "sim_node"), "--robot", "planar", "--start-points", str(planar_bag)]
        children.start([*command, "--discovery-wait", "0.2"], echo=False)
        over = train(planar, tmp_path / "graph", 260, "--over", "graph")
        for options, what in (
            ([*planar, "--reward", "sparse"], "the simulation's reward is dense; accepted: sparse"),
            ([*PENDULUM, "--env", "rled/PandaReach-v0", "--reward", "dense"], "the simulation is for robot planar"),
            (PENDULUM, "no simulation on the graph runs env 'Pendulum-v1'"),
        ):
            assert what in refused(options, tmp_path / "other", 300, "--over", "graph")
        children.check()
    assert "demonstrations.over changed" in refused(planar, tmp_path / "graph", 300, "--resume")
    assert_same(over, train(planar, tmp_path / "process", 260))
