import json
import re
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from rled_agent.experiments.archive import Archive, KeptRun, read_folder
from rled_agent.experiments.draw_figures import main as draw_figures
from rled_agent.experiments.execution import Stopped, _begun, _can_go_on, execute, is_done
from rled_agent.experiments.experiment import Drawing, ExperimentError, Library, Run, RunName
from rled_agent.experiments.jobs import Job, jobs_of
from rled_agent.experiments.pictures import draw
from rled_agent.experiments.reproduce import EXPERIMENTS, KEPT
from rled_agent.experiments.reproduce import main as reproduce
from rled_agent.experiments.statistics import Curve, common, estimate
from rled_agent.experiments.sweep import Finished, sweep
from rled_agent.experiments.tables import table
from rled_msgs_py.errors import RledError

ROOT = Path(__file__).parents[2]
SMALL = (
    *(
        "train_agent",
        "pendulum",
        "--schedule.steps",
        "300",
        "--schedule.log-every",
        "100",
        "--schedule.train-after",
        "50",
    ),
    *("--schedule.evaluate-every", "300", "--schedule.evaluation-episodes", "1", "--learner.actor.hidden", "8"),
    *("--learner.critic.hidden", "8", "--schedule.batch-size", "8"),
)
BASE = """
title = "Base"
claim = "It learns."
command = ["train_expert", "--bag", "bag"]
seeds = 2

[variants.plain]
label = "plain"
"""
UPON = """
title = "Upon it"
claim = "It learns more."
command = ["train_agent", "--expert", "{base/plain}/expert.safetensors"]
seeds = 2

[variants.a]
label = "A"
options = ["--phi", "0"]

[variants.b]
label = "B"
command = ["train_baseline"]
"""
VIEW = """
title = "The same, seen otherwise"
claim = "It shows."
runs_of = "upon"

[[drawings]]
kind = "curves"
metric = "reward"
label = "return"
"""


@pytest.fixture
def library(tmp_path: Path) -> Library:
    for name, text in (("base", BASE), ("upon", UPON), ("view", VIEW)):
        (tmp_path / f"{name}.toml").write_text(text)
    return Library(tmp_path)


def test_an_experiment_has_a_run_for_each_variant_and_seed(library):
    runs = library.read("upon").runs()
    assert [str(run.name) for run in runs] == ["upon/a/seed-0", "upon/b/seed-0", "upon/a/seed-1", "upon/b/seed-1"]
    first, peer = runs[2], runs[3]
    assert first.arguments(Path("out")) == [
        *("train_agent", "--expert", "out/base/plain/seed-1/expert.safetensors"),
        *("--phi", "0", "--seed", "1", "--output", "out/upon/a/seed-1"),
    ]
    assert peer.command == ("train_baseline", "--seed", "1")


def test_what_runs_need_comes_with_them(library):
    found = library.with_needs(["view"])
    assert {str(name) for name in found} == {
        *("upon/a/seed-0", "upon/a/seed-1", "upon/b/seed-0", "upon/b/seed-1"),
        *("base/plain/seed-0", "base/plain/seed-1"),
    }
    assert found[RunName("upon", "a", 1)].needs == (RunName("base", "plain", 1),)
    assert found[RunName("upon", "b", 1)].needs == ()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("seeds = 2", "seeds = 0"), "seeds of 1 or more"),
        (("seeds = 2", "sed = 2"), "sed in experiment; accepted: name"),
        (('"train_agent"', '"rm"'), "train_expert, train_agent"),
        (("{base/plain}", "{base/gone}"), "upon/a/seed-0 needs base/gone/seed-0"),
        (("{base/plain}", "{gone/plain}"), "no experiment 'gone'"),
        (("title = ", "title "), "a TOML file"),
        (('label = "A"', ""), "label"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path, library, change, said):
    (tmp_path / "upon.toml").write_text(UPON.replace(*change))
    with pytest.raises(ExperimentError, match=re.escape(said)):
        library.with_needs(["upon"])


def test_every_experiment_of_the_project_can_be_read():
    library = Library(ROOT / "docs" / "results" / "experiments")
    figures = [name for name in library.names() if name[0].isdigit() and "-" not in name]
    assert figures == ["4.3", "4.4", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10", "4.11", "4.12"]
    assert library.with_needs(library.names())
    for name in library.names():
        assert library.read(name).drawings


def runs_of(needs: dict[str, list[str]]) -> dict[RunName, Run]:
    names = {each: RunName("e", each, 0) for each in needs}
    commands = {each: ("train_agent", *(f"{{e/{need}}}" for need in needs[each])) for each in needs}
    return {names[each]: Run(names[each], commands[each]) for each in needs}


def swept(runs: dict[RunName, Run], make: Callable[[Job], list[Path]]) -> list[Finished]:
    told: list[Finished] = []
    with ThreadPoolExecutor(3) as pool:
        sweep(jobs_of(runs, 3), make, pool, told.append)
    return told


def test_a_run_is_made_after_those_that_it_needs():
    made: list[str] = []
    runs = runs_of({"d": ["b", "c"], "c": ["a"], "b": ["a"], "a": []})
    told = swept(runs, lambda job: made.append(job.runs[0].name.variant) or [])
    assert [each.error for each in told] == [None] * 4
    assert made[0] == "a"
    assert made[-1] == "d"


def test_what_needs_a_failed_run_is_left_out_and_the_others_are_made():
    def make(job: Job) -> list[Path]:
        if job.runs[0].name.variant == "b":
            raise RledError("it broke")
        return []

    told = swept(runs_of({"a": [], "b": [], "c": ["b"], "d": ["a"]}), make)
    ended = {(each.job.runs[0].name.variant, str(each.error or "")) for each in told}
    assert ended == {("a", ""), ("b", "it broke"), ("d", "")}


def test_the_seeds_of_a_variant_are_one_job_as_long_as_all_processors_are_busy(library):
    runs = library.with_needs(["upon"])
    alone = jobs_of(runs, 3)
    assert sorted(str(job) for job in alone) == [
        *("base/plain/seed-0", "base/plain/seed-1", "upon/a/seed-0 and 1 more", "upon/b/seed-0", "upon/b/seed-1")
    ]
    job = next(job for job in alone if len(job.runs) == 2)
    assert job.needs == (RunName("base", "plain", 0), RunName("base", "plain", 1))
    assert job.arguments(Path("out")) == [
        *("train_agent", "--expert", "out/base/plain/seed-{seed}/expert.safetensors", "--phi", "0"),
        *("--seeds", "0,1", "--output", "out/upon/a"),
    ]
    assert job._replace(device="cuda").arguments(Path("out"))[-2:] == ["--device", "cuda"]
    assert all(len(each.runs) == 1 for each in jobs_of(runs, 6))


def test_seeds_are_made_together_as_each_would_be_alone(tmp_path):
    runs = [Run(RunName("e", "v", seed), (*SMALL, "--seed", str(seed))) for seed in (0, 3)]
    folders = execute(Job(tuple(runs)), tmp_path / "both", Event())
    assert folders == [tmp_path / "both" / run.name.folder for run in runs]
    for run, folder in zip(runs, folders, strict=True):
        assert is_done(tmp_path / "both", run)
        assert json.loads((folder / "run.json").read_text())["population"] == 2
        execute(Job((run,)), tmp_path / "alone", Event())
        alone, both = (
            read_folder(root / run.name.folder, run.name) for root in (tmp_path / "alone", tmp_path / "both")
        )
        timed = {name for name in alone.tables["metrics"] if name.endswith("per_second")}
        for name, column in alone.tables["metrics"].items():
            assert name in timed or np.array_equal(column, both.tables["metrics"][name], equal_nan=True), name


def test_of_a_population_one_of_which_diverges_the_others_are_done(tmp_path, monkeypatch):
    runs = [Run(RunName("e", "v", seed), (*SMALL, "--seed", str(seed))) for seed in (0, 3)]

    def command(*_: Any) -> None:
        folder = tmp_path / runs[1].name.folder
        (folder / "diverged.json").write_text("{}")
        raise RledError("a loss is no number")

    monkeypatch.setattr("rled_agent.experiments.execution._run", command)
    with pytest.raises(RledError, match="no number"):
        execute(Job(tuple(runs)), tmp_path, Event())
    assert [is_done(tmp_path, run) for run in runs] == [True, False]


def test_a_run_is_done_once_and_anew_when_its_command_has_changed(tmp_path, planar_bag):
    command = ("train_expert", "--bag", str(planar_bag), "--steps", "20", "--validate-every", "10", "--batch-size", "8")
    run = Run(RunName("e", "v", 0), command)
    assert not is_done(tmp_path, run)
    folder = execute(Job((run,)), tmp_path, Event())[0]
    assert is_done(tmp_path, run)
    assert not is_done(tmp_path, Run(run.name, (*command, "--seed", "1")))
    archive = Archive(tmp_path / "kept")
    assert not archive.has(run)
    archive.add(read_folder(folder, run.name))
    assert archive.has(run)
    assert not archive.has(Run(run.name, (*command, "--seed", "1")))
    kept = Archive(tmp_path / "kept").read(run.name.experiment)[run.name]
    assert (set(kept.documents), set(kept.tables)) == ({"summary"}, {"curve"})
    assert kept.documents["summary"] == json.loads((folder / "summary.json").read_text())
    lines = (folder / "curve.csv").read_text().splitlines()
    assert [*kept.tables["curve"]] == lines[0].split(",")
    assert [value[-1] for value in kept.tables["curve"].values()] == [float(each) for each in lines[-1].split(",")]


def test_what_was_not_measured_is_no_point_of_a_curve_and_the_file_stays_plain_json(tmp_path):
    name = RunName("e", "v", 3)
    tables = {"metrics": {"step": np.array([1.0, 2.0, 3.0]), "reward": np.array([0.5, np.nan, 0.1 + 0.2])}}
    archive, record = Archive(tmp_path), {"command": ["train_agent"], "seconds": 1.5, "processor": "one"}
    archive.add(KeptRun(name, record, {"config": {"git": "abc"}}, tables))
    archive.add(KeptRun(RunName("e", "v", 10), record, {}, {}))
    text = (tmp_path / "e.jsonl").read_text()
    first, second = (json.loads(line, parse_constant=pytest.fail) for line in text.splitlines())
    assert (first["variant"], first["seed"], second["seed"]) == ("v", 3, 10)
    assert first["tables"]["metrics"]["reward"] == [0.5, None, 0.1 + 0.2]
    steps, values = Archive(tmp_path).read("e")[name].curve("reward")
    assert (steps.tolist(), values.tolist()) == ([1.0, 3.0], [0.5, 0.1 + 0.2])
    archive.add(KeptRun(name, record, {"config": {"git": "abc"}}, tables))
    assert (tmp_path / "e.jsonl").read_text() == text


@pytest.mark.parametrize("text", ["{", "[]", "1", '{"variant": "v"}', '{"variant": "v", "seed": 0, "tables": []}'])
def test_a_file_of_something_else_is_named(tmp_path, text):
    (tmp_path / "e.jsonl").write_text(text)
    with pytest.raises(RledError, match=r"e\.jsonl holds something else than runs"):
        Archive(tmp_path).read("e")


def test_a_run_that_was_broken_off_goes_on_unless_its_command_has_changed(tmp_path):
    def pendulum(steps: int) -> Run:
        return Run(RunName("e", "v", 0), ("train_agent", "pendulum", "--schedule.steps", str(steps)))

    def rows() -> list[list[str]]:
        return [line.split(",") for line in metrics_file.read_text().splitlines()[1:]] if metrics_file.exists() else []

    stop, metrics_file = Event(), tmp_path / "e" / "v" / "seed-0" / "metrics.csv"
    with ThreadPoolExecutor(1) as pool:
        broken = pool.submit(execute, Job((pendulum(100_000),)), tmp_path, stop)
        deadline = time.monotonic() + 60.0
        while len(rows()) < 2:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        stop.set()
        with pytest.raises(Stopped):
            broken.result()
    assert not is_done(tmp_path, pendulum(100_000))
    came_to = rows()
    with ThreadPoolExecutor(1) as pool:
        stop.clear()
        broken = pool.submit(execute, Job((pendulum(100_000),)), tmp_path, stop)
        while len(rows()) <= len(came_to):
            assert not broken.done()
            time.sleep(0.05)
        assert rows()[: len(came_to)] == came_to
        stop.set()
        with pytest.raises(Stopped):
            broken.result()
    anew = pendulum(1000)
    execute(Job((anew,)), tmp_path, Event())
    assert is_done(tmp_path, anew)
    assert json.loads((tmp_path / anew.name.folder / "run.json").read_text())["resumed"] is False
    assert float(rows()[-1][0]) == 1000.0


def test_a_failed_run_says_why_and_is_not_done(tmp_path):
    run = Run(RunName("e", "v", 0), ("train_expert", "--bag", "nowhere"))
    with pytest.raises(RledError, match="nowhere"):
        execute(Job((run,)), tmp_path, Event())
    assert not is_done(tmp_path, run)


def test_a_curve_is_smoothed_over_its_points():
    curve = Curve(np.arange(4.0), np.array([0.0, 2.0, 4.0, 0.0]))
    assert curve.smoothed(2).values.tolist() == [1.0, 3.0, 2.0]
    assert curve.smoothed(2).steps.tolist() == [1.0, 2.0, 3.0]
    assert curve.first_step(2.0) == 1.0
    assert curve.first_step(5.0) == np.inf


def test_the_end_of_a_curve_is_its_last_fifth():
    assert Curve(np.arange(10.0), np.arange(10.0)).end == 8.5


def test_the_middle_half_of_the_seeds_counts():
    found = estimate([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 1000.0])
    assert found.value == 3.5  # of 2, 3, 4 and 5
    assert found.low < 3.5 < found.high
    assert estimate([2.0, 2.0]) == (2.0, 2.0, 2.0)


def test_curves_are_compared_at_steps_that_all_have():
    one = Curve(np.array([1.0, 2.0, 3.0]), np.array([10.0, 20.0, 30.0]))
    other = Curve(np.array([2.0, 3.0, 4.0]), np.array([5.0, 6.0, 7.0]))
    steps, values = common([one, other])
    assert steps.tolist() == [2.0, 3.0]
    assert values.tolist() == [[20.0, 30.0], [5.0, 6.0]]


def a_run(columns: dict[str, list[float]] | None = None, **documents: Any) -> KeptRun:
    """A run with metrics and documents."""
    tables = {"metrics": {name: np.array(column) for name, column in (columns or {}).items()}}
    return KeptRun(RunName("e", "v", 0), {}, documents, tables)


def kept_runs(library: Library, name: str, value: Callable[[Run], list[float]]) -> None:
    """Runs that have been made: 100 steps a row."""
    archive = Archive(KEPT)
    for run in library.read(name).runs():
        values = np.array(value(run))
        steps = 100.0 * (np.arange(len(values)) + 1)
        table = {"step": steps, "reward": values, "demonstrated_share": np.full(len(values), 0.5)}
        record = {"command": run.command, "seconds": 360.0, "processor": "Some Processor", "resumed": False}
        archive.add(KeptRun(run.name, record, {}, {"metrics": table}))


def test_figures_and_numbers_come_from_the_runs_that_are_kept(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    EXPERIMENTS.mkdir(parents=True)
    level = VIEW.replace('runs_of = "upon"', 'runs_of = "upon"\nverdict = "partly"\nreason = "Only B rises."')
    for name, text in (("base", BASE), ("upon", UPON), ("view", level + "level = 8.0\n")):
        (EXPERIMENTS / f"{name}.toml").write_text(text)
    library = Library(EXPERIMENTS)
    # A stays at its seed; B rises by one a row to 9, and by two to 18
    kept_runs(
        library,
        "upon",
        lambda run: (
            [float(run.name.seed)] * 10 if run.name.variant == "a" else [(1.0 + run.name.seed) * k for k in range(10)]
        ),
    )
    monkeypatch.setattr("sys.argv", ["draw_figures"])
    draw_figures()
    assert "wrote docs/results.md" in capsys.readouterr().out
    text = Path("docs/results.md").read_text()
    assert "| [view](#the-same-seen-otherwise) | It shows. | partly reproduced |" in text
    assert "*Verdict:* **partly reproduced**. Only B rises." in text
    assert "*Runs:* 4 of 4, 0.4 processor hours (Some Processor)." in text
    # the last fifth of B is 8.5 and 17, the mean 4.5 and 9; it is at 8 from row 9 and from row 5 on
    assert "| B | 12.8 (8.5 to 17) | 6.75 (4.5 to 9) | 2 | 900, 500 |" in text
    assert "| A | 0.5 (0 to 1) | 0.5 (0 to 1) | 2 | never, never |" in text
    picture = Path("docs/results/figures/view.png")
    assert f"]({picture.relative_to('docs')})" in text
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_runs_that_are_kept_are_made_again_only_when_asked_for(tmp_path, monkeypatch, capsys):
    def shown(*options: str) -> list[str]:
        monkeypatch.setattr("sys.argv", ["reproduce", *options, "--show"])
        reproduce()
        return [line.split(":")[0].strip() for line in capsys.readouterr().out.splitlines()[1:]]

    monkeypatch.chdir(tmp_path)
    EXPERIMENTS.mkdir(parents=True)
    for name, text in (("base", BASE), ("upon", UPON)):
        (EXPERIMENTS / f"{name}.toml").write_text(text)
    library = Library(EXPERIMENTS)
    bases, uppers = ([str(run.name) for run in library.read(name).runs()] for name in ("base", "upon"))
    assert shown() == [*bases, *uppers]
    for name in ("base", "upon"):
        kept_runs(library, name, lambda run: [0.0])
    assert shown() == []
    assert shown("--anew") == [*bases, *uppers]
    assert shown("--anew", "--only", "a/seed-1") == ["upon/a/seed-1", "base/plain/seed-1"]
    made = Path("out/reproduce/base/plain/seed-0/run.json")
    made.parent.mkdir(parents=True)
    made.write_text(json.dumps({"command": library.read("base").runs()[0].command, "seconds": 1.0, "processor": "one"}))
    assert shown("upon", "--anew") == [*uppers, "base/plain/seed-1"]


def test_the_cloned_expert_stands_beside_the_curves_of_an_evaluation(tmp_path):
    runs = [
        a_run({"step": [100.0, 200.0], "evaluation_steps": [90.0, 10.0 + k]}, expert={"steps": 50.0 + 2.0 * k})
        for k in range(2)
    ]
    drawing = Drawing("curves", "evaluation_steps", "steps", level=51.0, cloning="cloned")
    rows = table(drawing, {"learned": runs}).splitlines()
    assert rows[2].startswith("| learned | 10.5 (10 to 11) | 50.2 (50 to 50.5) | 2 |")
    assert rows[3] == "| cloned | 51 (50 to 52) | 51 (50 to 52) | 2 | never, 0 |"
    draw(tmp_path / "with.png", [drawing], {"learned": runs}, "Beside it")
    draw(tmp_path / "without.png", [replace(drawing, cloning="")], {"learned": runs}, "Beside it")
    assert (tmp_path / "with.png").read_bytes() != (tmp_path / "without.png").read_bytes()


def test_whole_episodes_are_compared_with_the_experts(tmp_path):
    figures = {"reward": 1.0, "targets_reached": 15.0, "violations": 0.5}
    fast, slow = (
        a_run(episodes={"expert": figures | {"steps": 8.0}, "agent": figures | {"steps": steps}})
        for steps in (10.0, 20.0)
    )
    variants = {"late": [fast, slow], "in time": [fast]}
    drawing = Drawing("episodes", "steps", "steps of an episode")
    late, in_time = table(drawing, variants).splitlines()[2:]
    assert late == "| late | 15 (15 to 15) | 15 (10 to 20) | 0.5 (0.5 to 0.5) | 15 (15 to 15) | 8 (8 to 8) | 2 |"
    assert in_time.startswith("| in time | 15 (15 to 15) | 10 (10 to 10) |")
    draw(tmp_path / "late.png", [drawing], variants, "Late")
    assert (tmp_path / "late.png").read_bytes()[:4] == b"\x89PNG"


def test_experts_of_several_variants_are_told_apart(tmp_path):
    def evaluated(success: float) -> KeptRun:
        figures = {"success": success, "steps": 4.0, "path_length": None, "jerk": 100.0}
        bands = {band: {"expert": figures, "agent": figures | {"steps": 3.0}} for band in ("seen", "unseen")}
        return a_run(evaluation=bands)

    few, many = {"few": [evaluated(0.25)]}, {"many": [evaluated(1.0)]}
    rows = table(Drawing("bins"), few | many).splitlines()[2:]
    assert rows[0] == "| seen | few, expert | 0.25 (0.25 to 0.25) | 4 (4 to 4) | none | 100 (100 to 100) | 1 |"
    assert [row.split(" | ")[:2] for row in rows[1:5]] == [
        *(["| seen", "few"], ["| seen", "many, expert"], ["| seen", "many"], ["| unseen", "few, expert"]),
    ]
    assert table(Drawing("bins"), few).splitlines()[2].startswith("| seen | expert | 0.25")
    draw(tmp_path / "bands.png", [Drawing("bins")], few | many, "Bands")
    assert (tmp_path / "bands.png").read_bytes()[:4] == b"\x89PNG"


def test_long_labels_stay_within_the_picture(tmp_path):
    variants = {
        f"{k}: a method whose name says at length what it does and what not": [
            a_run({"step": [1.0, 2.0], "reward": [float(k), 0.0]})
        ]
        for k in range(7)
    }
    label = "a metric whose name says at length what is measured, where, and over how many steps the mean is taken"
    draw(tmp_path / "long.png", [Drawing("curves", "reward", label)], variants, "Long labels")
    pixels = imread(tmp_path / "long.png")[..., :3]
    assert pixels[:, [0, -1]].min() == 1.0  # white at both sides


def test_a_figure_is_drawn_of_the_runs_that_are_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    EXPERIMENTS.mkdir(parents=True)
    for name, text in (("base", BASE), ("upon", UPON), ("view", VIEW)):
        (EXPERIMENTS / f"{name}.toml").write_text(text)
    monkeypatch.setattr("sys.argv", ["draw_figures"])
    draw_figures()
    assert "*Runs:* 0 of 4, 0.0 processor hours (nowhere yet)." in Path("docs/results.md").read_text()


def test_a_run_whose_expert_was_made_anew_begins_anew(tmp_path):
    run = Run(RunName("e", "v", 0), ("train_agent", "planar_mc", "--expert", "{other/expert}/expert.safetensors"))
    folder, expert = tmp_path / run.name.folder, tmp_path / "other/expert/seed-0/expert.safetensors"
    for path in (folder, expert.parent):
        path.mkdir(parents=True)
    expert.write_bytes(b"weights")
    (folder / "checkpoint.safetensors").touch()
    (folder / "command.txt").write_text(_begun(run, tmp_path))
    assert _can_go_on(folder, run, tmp_path)
    (expert.parent / "checkpoint.safetensors").write_bytes(b"is nobody's input")
    assert _can_go_on(folder, run, tmp_path)
    expert.write_bytes(b"other weights")
    assert not _can_go_on(folder, run, tmp_path)
