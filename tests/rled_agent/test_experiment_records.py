"""Figures of runs that somebody else has written in: read, or one clear error."""

import json
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rled_agent.experiments.archive import Archive, KeptRun, is_record
from rled_agent.experiments.experiment import Drawing, ExperimentError, RunName, read_experiment
from rled_agent.experiments.records import read_bins, read_episodes, read_experts, read_traces
from rled_agent.training.tables import read_rows
from rled_msgs_py.errors import RledError

JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats() | st.text(max_size=5),
    lambda part: st.lists(part, max_size=3) | st.dictionaries(st.text(max_size=3), part, max_size=3),
    max_leaves=9,
)
READERS = {
    "evaluation": read_bins,
    "episodes": read_episodes,
    "motions": lambda run: read_traces(run, "seen"),
    "expert": lambda run: read_experts(Drawing("curves", "evaluation_steps"), {"one": [run]}),
}
SHARED = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=80)


def said_by(read) -> str:
    """What a reader refuses with; empty for what it takes."""
    try:
        read()
    except RledError as error:
        assert "\n" not in str(error)  # noqa: PT017
        assert len(str(error)) < 600  # noqa: PT017
        return str(error)
    return ""


def kept(documents: dict[str, object], tables: dict[str, dict[str, np.ndarray]] | None = None) -> KeptRun:
    return KeptRun(RunName("a", "b", 0), {}, documents, tables or {})


def test_rows_are_numbers_by_column(tmp_path):
    path = tmp_path / "metrics.csv"
    path.write_text("step,reward\n1,-2.5\n2,nan\n")
    first, second = read_rows(path, "step")
    assert first == {"step": 1.0, "reward": -2.5}
    assert math.isnan(second["reward"])


@SHARED
@given(st.binary(max_size=60) | st.text(alphabet='step,reward0123456789.-e"\n\r\x00', max_size=60).map(str.encode))
def test_any_bytes_for_a_table_are_rows_or_one_clear_error(tmp_path, content):
    path = tmp_path / "metrics.csv"
    path.write_bytes(content)
    said = said_by(lambda: read_rows(path, "reward"))
    assert not said or str(path) in said


def test_a_table_cut_anywhere_is_rows_or_one_clear_error(tmp_path):
    path, whole = tmp_path / "metrics.csv", b"step,reward,targets\n10,1.5,2\n20,2.5,3\n"
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        said = said_by(lambda: read_rows(path, "step", "targets"))
        if length < whole.index(b"\n"):
            assert f"{path} has no column" in said
        elif whole[:length].count(b",") % 2:
            assert f"{path} is damaged in line " in said


def test_a_folder_or_nothing_is_no_table(tmp_path):
    for path in (tmp_path, tmp_path / "gone"):
        assert f"{path} cannot be read" in said_by(lambda path=path: read_rows(path))


@given(st.sampled_from(sorted(READERS)), JSON)
def test_any_json_for_the_figures_of_a_run_is_one_clear_error(name, content):
    said = said_by(lambda: READERS[name](kept({name: content})))
    assert said.startswith(f"the {name} of a/b/seed-0 is not as it was written") or name == "episodes"


@pytest.mark.parametrize("name", READERS)
def test_figures_that_are_not_kept_are_named(name):
    assert f"the {name} of a/b/seed-0 is not as it was written (no " in said_by(lambda: READERS[name](kept({})))


def test_a_figure_that_is_no_number_is_refused():
    row = {"success": 1.0, "steps": 3.0, "path_length": 1.0, "jerk": None}
    bands = read_bins(kept({"evaluation": {"seen": {"agent": row}}}))
    assert math.isnan(bands["seen"]["agent"]["jerk"])
    for value in ("1", True, math.inf, [], {}):
        worse = kept({"evaluation": {"seen": {"agent": row | {"steps": value}}}})
        assert "for a number" in said_by(lambda run=worse: read_bins(run))


def test_a_metric_that_was_not_logged_is_named():
    run = kept({}, {"metrics": {"step": np.array([1.0]), "reward": np.empty(0)}})
    for metric in ("reward", "q"):
        assert f"a/b/seed-0 has no {metric} in its metrics" in said_by(lambda metric=metric: run.curve(metric))


@given(JSON)
def test_a_record_of_a_run_that_says_something_else_is_none(content):
    assert not is_record(content)


@SHARED
@given(st.dictionaries(st.sampled_from(["variant", "seed", "run", "documents", "tables"]), JSON))
def test_any_line_of_an_archive_is_one_clear_error(tmp_path, line):
    path = tmp_path / "e.jsonl"
    path.write_text(json.dumps(line) + "\n")
    assert f"{path} holds something else than runs" in said_by(lambda: Archive(tmp_path).read("e"))


@pytest.mark.parametrize("text", ["{", "[" * 10**5, "\x00", "NaN", '{"seen": ' * 3000, "\n"])
def test_a_line_that_is_no_json_is_refused_by_its_file(tmp_path, text):
    path = tmp_path / "e.jsonl"
    path.write_text(text)
    assert f"{path} holds something else than runs" in said_by(lambda: Archive(tmp_path).read("e"))


@pytest.mark.parametrize(
    "text",
    [
        "x", "[", 'seeds = "3"', "seeds = 1.5", "title = 3", "variants = 3", "variants = []", 'variants.a = "b"',
        "drawings = 3", "drawings = [3]", 'drawings = [{kind = "pie"}]', "drawings = [{kind = []}]", "command = 5",
        "command = [1]", 'verdict = "maybe"', 'unknown = "x"', "a = " + "[" * 5000, "variants.a.options = 3",
        'drawings = [{kind = "curves", level = "high"}]', 'drawings = [{kind = "curves", window = true}]',
    ],
)  # fmt: skip
def test_an_experiment_that_says_what_cannot_be_is_refused(tmp_path, text):
    path = tmp_path / "odd.toml"
    path.write_text(f'title = "t"\nclaim = "c"\n{text}\n' if "title" not in text else text)
    with pytest.raises(ExperimentError) as caught:
        read_experiment(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_experiment_that_is_no_text_is_refused(tmp_path):
    (tmp_path / "odd.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ExperimentError, match="UTF-8"):
        read_experiment(tmp_path / "odd.toml")
