import csv
import json
import math
import os
from pathlib import Path

import pytest
import torch
from rled_agent.training.checkpoint import Checkpoint
from rled_agent.training.run_directory import RunDirectory
from rled_msgs_py.errors import RledError

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
