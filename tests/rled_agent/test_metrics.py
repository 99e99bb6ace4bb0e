"""Figures of runs that somebody else has written in: read, or one clear error."""

import json
import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rled_agent.experiments.execution import record_of
from rled_agent.experiments.experiment import Drawing, ExperimentError, RunName, read_experiment
from rled_agent.experiments.records import read_bands, read_courses, read_episodes, read_experts
from rled_agent.experiments.statistics import read_columns, read_curve
from rled_agent.metrics import read_rows
from rled_msgs_py.errors import RledError

JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats() | st.text(max_size=5),
    lambda part: st.lists(part, max_size=3) | st.dictionaries(st.text(max_size=3), part, max_size=3),
    max_leaves=9,
)
READERS = {
    "evaluation.json": read_bands,
    "episodes.json": read_episodes,
    "motions.json": lambda run: read_courses(run, "seen"),
    "expert.json": lambda run: read_experts(Drawing("curves", "evaluation_steps"), {"one": [run]}),
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
    said = said_by(lambda: read_curve(path, "reward"))
    assert not said or str(path) in said


def test_a_table_cut_anywhere_is_rows_or_one_clear_error(tmp_path):
    path, whole = tmp_path / "metrics.csv", b"step,reward,targets\n10,1.5,2\n20,2.5,3\n"
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        said = said_by(lambda: read_columns(path, "step", "targets"))
        if length < whole.index(b"\n"):
            assert f"{path} h" in said  # "has no column", "holds no rows"
        elif whole[:length].count(b",") % 2:
            assert f"{path} is damaged in line " in said


def test_a_folder_or_nothing_is_no_table(tmp_path):
    for path in (tmp_path, tmp_path / "gone"):
        assert f"{path} cannot be read" in said_by(lambda path=path: read_rows(path))


@SHARED
@given(st.sampled_from(sorted(READERS)), JSON)
def test_any_json_for_the_figures_of_a_run_is_one_clear_error(tmp_path, name, content):
    (tmp_path / name).write_text(json.dumps(content))
    said = said_by(lambda: READERS[name](tmp_path))
    assert str(tmp_path / name) in said or name == "episodes.json"


@pytest.mark.parametrize("text", ["", "{", "[" * 10**5, "\x00", "NaN", '{"seen": ' * 3000])
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_json_is_refused_by_its_file(tmp_path, name, text):
    assert f"{tmp_path / name} is not as it was written" in said_by(lambda: READERS[name](tmp_path))
    (tmp_path / name).write_text(text)
    assert f"{tmp_path / name} is not as it was written" in said_by(lambda: READERS[name](tmp_path))


def test_a_figure_that_is_no_number_is_refused(tmp_path):
    row = {"success": 1.0, "steps": 3.0, "path_length": 1.0, "jerk": None}
    path = tmp_path / "evaluation.json"
    path.write_text(json.dumps({"seen": {"agent": row}}))
    assert math.isnan(read_bands(tmp_path)["seen"]["agent"]["jerk"])
    for value in ("1", True, math.inf, [], {}):
        path.write_text(json.dumps({"seen": {"agent": row | {"steps": value}}}))
        assert "for a number" in said_by(lambda: read_bands(tmp_path))


@SHARED
@given(JSON)
def test_a_record_of_a_run_that_says_something_else_is_none(tmp_path, content):
    name = RunName("a", "b", 0)
    (tmp_path / name.folder).mkdir(parents=True, exist_ok=True)
    (tmp_path / name.folder / "run.json").write_text(json.dumps(content))
    assert record_of(tmp_path, name) is None


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
