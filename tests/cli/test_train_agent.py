"""The command, with options as a person types them."""

import hashlib
import json
import math
import sys
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest
import torch
from rled_agent.cli import train_agent
from rled_agent.cli.presets import PRESETS
from rled_agent.data.closed_form import joined_points
from rled_agent.methods import all_methods
from rled_agent.nn.policy import load_policy
from rled_agent.training.checkpoint import read_checkpoint
from rled_agent.training.digests import bag_digest
from rled_agent.training.environments import make_environment
from rled_agent.training.run import Inputs, composed
from rled_agent.training.run_directory import RunDirectory
from rled_agent.training.trainer import Trainer
from rled_msgs_py.bags import Bag
from rled_msgs_py.processes import Children, program

from .conftest import PENDULUM, SMALL, assert_same, rows

FILES = {
    "expert.json", "checkpoint.safetensors", "config.json", "metrics.csv", "policy.safetensors", "best.safetensors"
}  # fmt: skip


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


def test_the_same_seed_gives_the_same_run_and_another_seed_another(train, tmp_path) -> None:
    one, same = (train(PENDULUM, tmp_path / name, 150) for name in ("one", "same"))
    assert_same(one, same)
    other = train(PENDULUM, tmp_path / "other", 150, "--seed", "1")
    assert not torch.equal(one.tensors["learner.actor.weights.0"], other.tensors["learner.actor.weights.0"])


def test_a_folder_with_a_run_is_not_overwritten(train, refused, tmp_path) -> None:
    train(PENDULUM, tmp_path, 50)
    assert "holds a run already" in refused(PENDULUM, tmp_path, 50)


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


def test_a_loss_that_is_no_number_names_the_step_and_the_last_good_checkpoint(refused, monkeypatch, tmp_path) -> None:
    update = Trainer.advance

    def poisoned(trainer) -> None:
        if trainer.step == 140:
            trainer.learning.replay.rows[:, :, 4] = np.nan  # rewards, as an environment that breaks would pay
        update(trainer)

    monkeypatch.setattr(Trainer, "advance", poisoned)
    line = refused(PENDULUM, tmp_path, 300)
    assert "no number at step 150" in line
    assert line.endswith(f"the last good checkpoint is {tmp_path / 'checkpoint.safetensors'}")
    assert read_checkpoint(tmp_path / "checkpoint.safetensors").state["run.step"] == 100


def test_training_over_the_graph_is_training_in_the_same_environment(
    train, refused, planar, planar_bag, planar_expert, tmp_path
) -> None:
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
    config, demonstrations = RunDirectory(tmp_path / "graph").settings(all_methods()), joined_points(Bag(planar_bag))
    inputs = Inputs(demonstrations, (load_policy(planar_expert),))
    with composed([config], inputs, lambda task: make_environment(config, demonstrations.starts)) as population:
        while population.trainer.step < 260:
            population.trainer.advance()
        assert_same(over, *population.trainer.checkpoints())
