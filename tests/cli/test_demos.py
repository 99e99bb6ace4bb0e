"""The command ``demos``: what it prints and writes, its exit codes, and that nothing makes it fall over."""

import json
import shlex
import shutil
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from rled_agent.data.demonstrations import DemonstrationError
from rled_agent.data.episode_filter import SelectionError
from rled_agent.data.opening import open_demonstrations
from rled_msgs_py.bags import Bag, BagError, BagWriter, repair, review
from rled_msgs_py.processes import program
from rled_msgs_py.records import Text
from rled_msgs_py.topics import JOINT_STATES, ROBOT_DESCRIPTION, TASK_DESCRIPTION
from rled_teleop.cli import demos
from rled_teleop.cli.plot import draw_joints, draw_paths

from ..rled_msgs_py.samples import ENTRIES, TASK, descriptions, tick, write_bag

BAGS = Path(__file__).parents[2] / "bags"
QUIET = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]


def run(*arguments):
    """Exit code of the command, run in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["demos", *map(str, arguments)])
        try:
            demos.main()
        except SystemExit as ended:
            return ended.code
    return 0


@pytest.fixture
def said(capsys):
    """Run the command; returns exit code and what it printed, errors last."""

    def call(*arguments):
        capsys.readouterr()
        code = run(*arguments)
        captured = capsys.readouterr()
        return code, captured.out + captured.err

    return call


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag", ticks=50)


def written(path, found):
    with BagWriter(path) as bag:
        for topic, record in [*descriptions(), *found]:
            bag.write(topic, record)
    return path


def entries(first, last):
    return [entry for k in range(first, last) for entry in tick(k)]


@pytest.mark.parametrize("name", ["panda_lemniscate", "planar_lemniscate"])
def test_the_bags_of_the_project_have_no_faults(said, name):
    code, text = said("check", BAGS / name)
    assert code == 0
    assert "no faults" in text
    assert "200 episodes" in text


def test_info_tells_topics_coverage_and_quality(said):
    code, text = said("info", BAGS / "planar_lemniscate", "--json")
    found = json.loads(text)
    assert code == 0
    assert (found["robot"], found["messages"], found["seconds"], found["faults"]) == ("planar", 6061, 21.02, 0)
    assert {each["topic"]: each["messages"] for each in found["topics"]}["joint_delta"] == 1051
    assert all(each["rate_hz"] == 50.0 and each["falls_back"] == 0 for each in found["topics"])
    assert len(found["episodes"]) == 200
    assert all(each["reached"] == 1.0 and each["score"] > 0.8 for each in found["episodes"])
    assert 0.9 < found["coverage"] <= 1.0
    code, text = said("info", BAGS / "planar_lemniscate")
    assert code == 0
    assert len(text.splitlines()) == 2 + 8 + 4 + 201


def test_info_counts_unanswered_states_and_losses(said, tmp_path):
    found = [each for each in entries(0, 30) if not (each[0].name == "joint_delta" and each[1].stamp == 200_000_000)]
    code, text = said("info", written(tmp_path / "bag", found + entries(33, 40)), "--json")
    assert code == 0
    assert [json.loads(text)[name] for name in ("unanswered", "lost", "faults")] == [1, 1, 1]


def test_check_names_episode_time_and_remedy_and_the_remedy_works(said, tmp_path):
    path = written(tmp_path / "bag", entries(0, 40) + entries(0, 30))
    code, text = said("check", path)
    assert code == 1
    assert text == (
        f"stamps backwards: all state topics, episode 1, from 0.78 s to 0.80 s: the stamp falls back by 0.780 s; "
        f"keep the longer part with: demos trim {path} --to 0.79 --output NEW\n"
    )
    for option, ticks in (("--to", 40), ("--from", 30)):
        assert said("trim", path, option, "0.790", "--output", tmp_path / option)[0] == 0
        assert Bag(tmp_path / option).counts["joint_states"] == ticks
        assert said("check", tmp_path / option)[0] == 0


def test_the_commands_go_on_with_a_bag_in_which_the_description_changes(said, tmp_path):
    other = (TASK_DESCRIPTION, Text(replace(TASK, max_steps=50).to_json()))
    path = written(tmp_path / "a bag", [*entries(0, 40), other, *entries(0, 30)])
    code, text = said("check", path)
    assert (code, text.count("\n")) == (1, 1)
    remedy = shlex.split(text.split("with: ")[1])
    assert remedy[:2] == ["demos", "trim"]
    assert said(*remedy[1:-1], tmp_path / "second")[0] == 0
    for number, (bag, ticks) in enumerate(((path, 40), (tmp_path / "second", 30))):
        assert f"joint_states{ticks:>10}" in said("info", bag)[1]
        assert said("trim", bag, "--output", tmp_path / f"part {number}")[0] == 0
        assert said("check", tmp_path / f"part {number}")[0] == 0
    assert said("trim", path, "--part", 3, "--output", tmp_path / "third")[0] == 2


@pytest.mark.parametrize("kind", ["cut", "flipped", "empty", "foreign", "missing", "no task"])
def test_a_bag_that_cannot_be_read_is_one_line_and_code_2(said, bag, tmp_path, kind):
    (file,) = bag.glob("*.mcap")
    data = bytearray(file.read_bytes())
    data[len(data) // 3] ^= 8
    contents = {"cut": data[:-500], "flipped": data, "empty": b"", "foreign": b"hello, this is some text"}
    if kind in contents:
        file.write_bytes(contents[kind])
    if kind == "missing":
        shutil.rmtree(bag)
    if kind == "no task":
        with BagWriter(bag, overwrite=True) as writer:
            writer.write(*tick(0)[0])
    for command in ("check", "info"):
        code, text = said(command, bag)
        assert (code, len(text.splitlines())) == (2, 1)
        assert text.startswith("error: ")


def test_repair_completes_a_bag_in_place(said, bag):
    (bag / "metadata.yaml").unlink()
    assert said("check", bag)[0] == 2
    assert said("repair", bag) == (0, f"{bag} is complete and holds 252 messages\n")
    assert said("check", bag)[0] == 0


def test_trim_drop_and_merge_make_bags_without_faults(said, tmp_path):
    planar = BAGS / "planar_lemniscate"
    assert said("trim", planar, "--from", 8, "--to", 9, "--output", tmp_path / "a")[0] == 0
    assert said("drop", tmp_path / "a", "--episodes", "0,2", "--output", tmp_path / "b")[0] == 0
    assert said("merge", tmp_path / "a", tmp_path / "b", "--output", tmp_path / "c")[0] == 0
    numbers = [len(review(Bag(tmp_path / name)).episodes) for name in "abc"]
    assert numbers == [15, 13, 28]
    for name in "abc":
        assert said("check", tmp_path / name)[0] == 0
    assert said("trim", planar, "--from", 8, "--output", tmp_path / "a")[0] == 2


@pytest.mark.parametrize(
    "options",
    [
        ["trim", "BAG", "--from", "3", "--to", "2", "--output", "OUT"],
        ["trim", "BAG", "--from", "nan", "--output", "OUT"],
        ["drop", "BAG", "--episodes", "one", "--output", "OUT"],
        ["drop", "BAG", "--episodes", "", "--output", "OUT"],
        ["drop", "BAG", "--episodes", "-1", "--output", "OUT"],
        ["drop", "BAG", "--episodes", "77", "--output", "OUT"],
        ["merge", "BAG", "--output", "OUT"],
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(said, bag, tmp_path, options):
    names = {"BAG": bag, "OUT": tmp_path / "out"}
    code, text = said(*(names.get(option, option) for option in options))
    assert code == 2
    assert options[-2] != "--output" or "error: " in text or "Parsing error" in text or "required" in text.lower()
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("episodes", "named"), [(1, "episode 0"), (3, "episodes 0, 2, 4 ...")])
def test_a_plot_explains_all_that_it_shows_beside_it(tmp_path, monkeypatch, episodes, named):
    drawn = []

    @contextmanager
    def picture(path, width, height):
        figure = Figure(figsize=(width, height), layout="constrained")
        drawn.append(figure.add_subplot())
        yield drawn[-1]
        figure.savefig(tmp_path / path)

    monkeypatch.setattr("rled_teleop.cli.plot.picture", picture)
    bag = Bag(BAGS / "planar_lemniscate")
    found, task = review(bag), bag.task
    found = found._replace(episodes=found.episodes[:episodes], qualities=found.qualities[:episodes])
    draw_paths(Path("paths.png"), found, task)
    draw_joints(Path("joints.png"), found, task)
    assert drawn[0].get_title() == f"{task.robot}: {episodes} {'episode' if episodes == 1 else 'episodes'}"
    labels = [[text.get_text() for text in axes.get_legend().get_texts()] for axes in drawn]
    assert labels == [["path, quality 1", "path, quality 0", "target"], [named, *task.joint_names]]
    for axes in drawn:
        assert axes.get_legend().get_window_extent().x0 >= axes.get_window_extent().x1


def test_plot_writes_two_pictures(said, bag, tmp_path):
    assert said("plot", bag, "--output", tmp_path / "plots")[0] == 0
    for name in ("paths.png", "joints.png"):
        assert (tmp_path / "plots" / name).read_bytes()[:4] == b"\x89PNG"


def test_the_executable_ends_with_the_code(tmp_path):
    command = [*program("rled_teleop", "demos"), "check", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, len(done.stderr.splitlines()), done.stdout) == (2, 1, "")


@settings(max_examples=80, suppress_health_check=QUIET)
@given(
    kind=st.sampled_from(["flip", "cut", "splice", "twice"]),
    at=st.floats(0, 1, exclude_max=True),
    bit=st.integers(0, 7),
)
def test_a_changed_bag_is_refused_or_checked_as_what_it_was(kind, at, bit):
    with tempfile.TemporaryDirectory() as folder:
        path = write_bag(Path(folder) / "bag", ticks=6)
        (file,) = path.glob("*.mcap")
        data = bytearray(file.read_bytes())
        place = int(at * len(data))
        if kind == "flip":
            data[place] ^= 1 << bit
        elif kind == "cut":
            del data[place:]
        elif kind == "splice":
            del data[place : place + 1 + 37 * bit]
        else:
            data[place:place] = data[place // 2 : place // 2 + 64]
        file.write_bytes(data)
        code = run("check", path)
        if code == 2:  # what can be saved of it is a prefix or has gaps, and is checked without falling over
            shutil.copytree(path, Path(folder) / "copy")
            try:
                repair(Path(folder) / "copy")
            except BagError:
                return
            assert run("check", Path(folder) / "copy") in (0, 1, 2)
        else:
            assert code == 0
            assert Bag(path).message_count == 2 + 5 * 6


@settings(max_examples=60, suppress_health_check=QUIET)
@given(st.lists(ENTRIES.filter(lambda entry: entry[0] not in (TASK_DESCRIPTION, ROBOT_DESCRIPTION)), max_size=12))
def test_any_records_are_checked_without_falling_over(found):
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder) / "bag", found)
        assert run("check", path) in (0, 1, 2)
        assert run("info", path) in (0, 2)


@settings(max_examples=60, suppress_health_check=QUIET)
@given(st.lists(st.integers(0, 30), min_size=1, max_size=30))
def test_ticks_in_any_order_are_checked_without_falling_over(order):
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder) / "bag", [each for k in order for each in tick(k)])
        falls = any(after < before for before, after in pairwise(order))
        assert run("check", path) in ((1,) if falls else (0, 1))
        assert run("info", path) == 0


def test_train_expert_leaves_faulty_and_poor_episodes_out_and_says_so(tmp_path):
    planar, lines = BAGS / "planar_lemniscate", list[str]()
    everything = open_demonstrations(planar, "trajectories")
    best = open_demonstrations(planar, "trajectories", 0.95, lines.append)
    scores = np.array([quality.score for quality in review(Bag(planar)).qualities])
    assert len(np.unique(best.answers.trajectory)) == (scores >= 0.95).sum()
    assert 0 < len(best) < len(everything)
    assert len(lines) == 1
    assert lines[0].endswith(": quality below 0.95")
    with pytest.raises(SelectionError, match="no episode"):
        open_demonstrations(planar, "trajectories", 1.0)
    with pytest.raises(DemonstrationError, match="--source points"):
        open_demonstrations(planar, "points", 0.5)


def test_train_expert_leaves_out_just_the_moments_of_a_loss(tmp_path):
    planar = Bag(BAGS / "planar_lemniscate")
    episode = next(each for each in review(planar).episodes if each.last - each.first >= 100_000_000)
    gone = (episode.first + 40_000_000, episode.first + 60_000_000)
    with BagWriter(tmp_path / "bag") as writer:
        for message in planar.messages():
            stamp = message.log_time
            if not gone[0] <= stamp <= gone[1] or message.topic.name.endswith("description"):
                writer.copy(message.topic, message.data, message.log_time, message.publish_time)
    lines = list[str]()
    left = open_demonstrations(tmp_path / "bag", "trajectories", 0.0, lines.append)
    assert len(left) == len(open_demonstrations(BAGS / "planar_lemniscate", "trajectories")) - 2
    assert len(np.unique(left.answers.trajectory)) == 201  # one of 200 is in two pieces
    assert len(lines) == 1
    assert "joint_states, ee_pose, target_pose, task_status: 2 ticks are missing" in lines[0]
    assert len(open_demonstrations(tmp_path / "bag", "points")) > 0


def test_train_expert_refuses_a_bag_of_two_publishers_naming_the_remedy(tmp_path):
    second = [(JOINT_STATES, replace(tick(k)[0][1], position=np.ones(2))) for k in range(20, 30)]
    path = written(tmp_path / "bag", sorted(entries(0, 40) + second, key=lambda entry: entry[1].stamp))
    with pytest.raises(SelectionError, match=r"two publishers: joint_states at 0\.40 s.*demos check"):
        open_demonstrations(path, "trajectories")
