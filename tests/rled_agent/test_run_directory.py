"""The folder of a run, the digests of its inputs, and what a run that goes on shares with the one that began."""

import copy
import csv
import hashlib
import json
import math
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch
from rled_agent.nn.tensor_file import TensorFileError
from rled_agent.training.checkpoint import Checkpoint
from rled_agent.training.digests import bag_digest, file_digest
from rled_agent.training.resuming import require_same_run
from rled_agent.training.run_directory import RunDirectory
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.errors import RledError
from rled_msgs_py.topics import DIAGNOSTICS, JOINT_DELTA, MARKED_JOINT_STATES, RECORDED

NAN = math.nan


def rows(path: Path) -> list[dict[str, float]]:
    with path.open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def test_a_new_run_records_settings_and_versions(tmp_path):
    directory = RunDirectory(tmp_path / "run")
    directory.create({"config": {"seed": 3}})
    record = json.loads((tmp_path / "run" / "config.json").read_text())
    assert record["config"] == {"seed": 3}
    assert record["torch"] == torch.__version__
    assert record["git"]
    assert directory.config() == record


def test_a_folder_that_holds_a_run_is_refused_and_kept(tmp_path):
    RunDirectory(tmp_path).create({"config": {"seed": 3}})
    before = (tmp_path / "config.json").read_bytes()
    with pytest.raises(RledError, match=r"holds a run already; accepted: a new --output; or continue it with --resume"):
        RunDirectory(tmp_path).create({"config": {"seed": 4}})
    assert (tmp_path / "config.json").read_bytes() == before


@pytest.mark.parametrize("text", [None, "{", ""])
def test_a_folder_without_a_run_cannot_be_continued(tmp_path, text):
    if text is not None:
        (tmp_path / "config.json").write_text(text)
    with pytest.raises(RledError, match="holds no run"):
        RunDirectory(tmp_path).config()


def test_metrics_are_a_table_whose_later_columns_are_kept(tmp_path):
    directory = RunDirectory(tmp_path)
    directory.append({"step": 10.0, "reward": -1.5})
    assert rows(directory.metrics_path) == [{"step": 10.0, "reward": -1.5}]
    directory.append({"step": 20.0, "reward": NAN, "evaluation_reward": 3.0})
    first, second = rows(directory.metrics_path)
    assert first["reward"] == -1.5
    assert math.isnan(first["evaluation_reward"])
    assert second["evaluation_reward"] == 3.0


def test_rows_after_the_checkpoint_are_dropped_on_continuing(tmp_path):
    before = RunDirectory(tmp_path)
    for step in (10.0, 20.0, 30.0):
        before.append({"step": step, "reward": -step})
        if step == 20.0:
            before.save(Checkpoint({"weights": torch.ones(2)}, {"run.step": 20}))
    after = RunDirectory(tmp_path)
    assert after.load().state == {"run.step": 20}
    assert [row["step"] for row in rows(after.metrics_path)] == [10.0, 20.0]
    after.append({"step": 30.0, "reward": -31.0})
    assert [row["reward"] for row in rows(after.metrics_path)] == [-10.0, -20.0, -31.0]


def test_the_step_is_that_of_the_checkpoint(tmp_path):
    directory = RunDirectory(tmp_path)
    directory.save(Checkpoint({"weights": torch.ones(2)}, {"run.step": 20}))
    assert directory.step() == 20
    for state in ({}, {"run.step": -1}, {"run.step": 2.5}, {"run.step": "20"}):
        directory.save(Checkpoint({}, state))
        with pytest.raises(TensorFileError, match=r"checkpoint"):
            directory.step()
    directory.checkpoint_path.write_bytes(b"nothing")
    with pytest.raises(TensorFileError, match="is damaged"):
        directory.step()


def test_a_run_that_has_diverged_says_so_with_the_step(tmp_path):
    directory = RunDirectory(tmp_path)
    assert not directory.diverged_path.exists()
    directory.write_diverged(140)
    assert directory.diverged_path == tmp_path / "diverged.json"
    assert json.loads(directory.diverged_path.read_text()) == {"step": 140}


def test_no_temporary_file_is_left(tmp_path):
    directory = RunDirectory(tmp_path)
    directory.create({})
    directory.append({"step": 1.0})
    directory.save(Checkpoint({}, {"run.step": 1}))
    assert sorted(os.listdir(tmp_path)) == ["checkpoint.safetensors", "config.json", "metrics.csv"]


def test_the_best_evaluation_is_the_greatest_return_then_the_fewest_steps(tmp_path):
    directory = RunDirectory(tmp_path)
    found = []
    for reward, steps in ((NAN, NAN), (3.0, 50.0), (2.0, 40.0), (NAN, NAN), (3.0, 50.0), (3.0, 49.0), (4.0, 60.0)):
        directory.append({"step": 1.0, "evaluation_reward": reward, "evaluation_steps": steps})
        found.append(directory.ends_in_the_best())
    assert found == [False, True, False, False, False, True, True]


# What an input holds decides its digest, not where it lies or how it is packed.


TOPICS = {topic.name: topic for topic in RECORDED}


def rewritten(source: Bag, path: Path, change=lambda name, data: data, order=lambda messages: messages) -> Bag:
    """The messages of a bag in a new one, in another order or with other content; None leaves one out."""
    with BagWriter(path) as writer:
        for each in order(list(source.messages())):
            name = source.name_of(each)
            data = change(name, each.data)
            if data is not None:
                writer.write_cdr(TOPICS[name], data, each.log_time)
    return Bag(path)


def test_a_file_has_the_sha_256_of_its_bytes(tmp_path):
    (tmp_path / "a").write_bytes(b"weights")
    assert file_digest(tmp_path / "a") == hashlib.sha256(b"weights").hexdigest()
    for path in (tmp_path, tmp_path / "gone"):
        with pytest.raises(RledError, match=f"can't read {path}"):
            file_digest(path)


def test_a_copy_the_bare_file_and_a_bag_written_anew_have_one_digest(planar_bag, tmp_path):
    bag = Bag(planar_bag)
    copied = shutil.copytree(planar_bag, tmp_path / "copied")
    (mcap,) = copied.glob("*.mcap")
    (copied / "metadata.yaml").rename(tmp_path / "metadata.yaml")
    anew = rewritten(bag, tmp_path / "anew")
    swapped = rewritten(bag, tmp_path / "swapped", order=lambda messages: [messages[1], messages[0], *messages[2:]])
    assert {bag_digest(each) for each in (bag, Bag(mcap), anew, swapped)} == {bag_digest(bag)}


def test_every_message_counts(planar_bag, tmp_path):
    bag, seen = Bag(planar_bag), 0

    def last_byte(name: str, data: bytes) -> bytes:
        nonlocal seen
        seen += name == MARKED_JOINT_STATES.name
        return data[:-1] + bytes([data[-1] ^ 1]) if name == MARKED_JOINT_STATES.name and seen == 7 else data

    others = [
        rewritten(bag, tmp_path / "changed", last_byte),
        rewritten(bag, tmp_path / "fewer", lambda name, data: None if name == JOINT_DELTA.name else data),
    ]
    assert len({bag_digest(each) for each in (bag, *others)}) == 3


def test_what_lies_beside_the_demonstration_does_not_count(planar_bag, tmp_path):
    bag = Bag(planar_bag)
    (message, *_) = bag.messages()
    with BagWriter(tmp_path / "more") as writer:
        for each in bag.messages():
            writer.write_cdr(TOPICS[bag.name_of(each)], each.data, each.log_time)
        writer.write_cdr(DIAGNOSTICS, message.data, message.log_time)
    assert bag_digest(Bag(tmp_path / "more")) == bag_digest(bag)


# A run goes on only as the run that began.


BEGAN: dict[str, Any] = {
    "config": {
        "method": "td3", "settings": {"learner": {"actor": {"hidden": [8, 6]}}}, "seed": 3, "schedule": {"steps": 100}
    },
    "demonstrations": {
        "bag": "a/bag", "bag_sha256": "1" * 64, "expert": "a/expert", "expert_sha256": "2" * 64, "points": 0,
        "over": "graph", "simulation": {"max_steps": 100, "limits": {"collisions": False}},
    },
}  # fmt: skip


def changed(**values: Any) -> dict[str, Any]:
    """The record with values of dotted names, with two underscores for a dot."""
    record = copy.deepcopy(BEGAN)
    for name, value in values.items():
        *path, last = name.split("__")
        part = record
        for each in path:
            part = part[each]
        part[last] = value
    return record


@pytest.mark.parametrize(
    "values",
    [{}, {"config__schedule__steps": 900}, {"demonstrations__bag": "b/bag", "demonstrations__expert": "b/expert"}],
)
def test_more_steps_and_the_same_files_elsewhere_go_on(values):
    require_same_run(BEGAN, changed(**values), Path("run"))
    require_same_run(BEGAN | {"git": "abc"}, changed(**values), Path("run"))


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"demonstrations__bag_sha256": "3" * 64}, "what is in the bag a/bag has changed since the run began"),
        ({"demonstrations__expert_sha256": "3" * 64}, "what is in the expert a/expert has changed since the run began"),
        (
            {"demonstrations__expert": "b", "demonstrations__expert_sha256": "3"},
            "the expert b holds something else",
        ),
        ({"demonstrations__bag": "None", "demonstrations__bag_sha256": None}, "the bag None holds something else than"),
        ({"demonstrations__points": 7}, "demonstrations.points changed since the run began; accepted: .*points 0"),
        (
            {"config__settings__learner__actor__hidden": [8, 7]},
            "config.settings.learner.actor.hidden changed",
        ),
        ({"config__method": "ddpg"}, "the method is ddpg, and the run began with another; accepted: td3"),
        ({"demonstrations__simulation__max_steps": 50}, "demonstrations.simulation.max_steps changed since"),
        (
            {"demonstrations__simulation__limits__collisions": True},
            "simulation.limits.collisions changed",
        ),
        ({"demonstrations__over": "process", "demonstrations__simulation": None}, "^demonstrations.over changed since"),
        ({"config__more": 1}, r"begun by a version with other settings \(config.more\)"),
    ],
)
def test_what_is_not_the_same_is_named(values, said):
    with pytest.raises(RledError, match=said) as caught:
        require_same_run(BEGAN, changed(**values), Path("run"))
    assert "begin a new run with another --output" in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("began", [{}, {"config": [], "demonstrations": 3}, {"config": None}, {"config": {}}])
def test_what_no_run_wrote_is_of_another_version(began):
    with pytest.raises(RledError, match="the run in run was begun by a version with other settings"):
        require_same_run(began, BEGAN, Path("run"))
