"""Every command looks at its output before it works: a file in its way ends it within its first steps."""

import importlib
import sys
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[str, list[str]], str]:
    """Run a command in this process; the one line that it ends with."""

    def run(module: str, options: list[str]) -> str:
        monkeypatch.setattr(sys, "argv", [module.rpartition(".")[2], *options])
        with pytest.raises(SystemExit) as ended:
            importlib.import_module(module).main()
        assert ended.value.code == 2
        (line,) = capsys.readouterr().err.splitlines()
        return line

    return run


COMMANDS = {
    "rled_agent.cli.train_expert": ["--bag", "BAG", "--output", "OUT"],
    "rled_agent.cli.train_agent": ["planar_mc_tuned", "--bag", "BAG", "--expert", "EXPERT", "--output", "OUT"],
    "rled_agent.cli.train_baseline": ["--bag", "BAG", "--env", "rled/PlanarReach-v0", "--output", "OUT"],
    "rled_agent.cli.evaluate_agent": ["--bag", "BAG", "--expert", "EXPERT", "--output", "OUT"],
    "rled_agent.cli.demo": ["--output", "OUT"],
    "rled_agent.experiments.reproduce": ["--runs", "OUT"],
    "rled_agent.nodes.watch_episodes": ["--output", "OUT"],
    "rled_teleop.cli.demos": ["plot", "BAG", "--output", "OUT"],
}


@pytest.mark.parametrize("below", ["", "deeper"])
@pytest.mark.parametrize("module", COMMANDS)
def test_a_file_in_the_way_is_said_before_anything_is_read(module, below, run, tmp_path) -> None:
    """The bag and the expert do not exist: whoever read them first would say that."""
    (tmp_path / "out").touch()
    output = tmp_path / "out" / below
    places = {"BAG": "/nowhere/bag", "EXPERT": "/nowhere/expert", "OUT": str(output)}
    said = run(module, [places.get(each, each) for each in COMMANDS[module]])
    option = "--runs" if module.endswith("reproduce") else "--output"
    assert said.startswith(f"error: {tmp_path / 'out'} is no folder; accepted: a folder for the results; name another ")
    assert said.endswith(option)


def test_figures_are_drawn_in_the_project_s_folder(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").touch()
    said = run("rled_agent.experiments.draw_figures", [])
    assert said == "error: docs is no folder; accepted: a folder for the results; run it in the project's folder"


def test_where_there_are_no_experiments_none_are_drawn(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for module in ("rled_agent.experiments.draw_figures", "rled_agent.experiments.reproduce"):
        said = run(module, [])
        assert said.startswith("error: there are no experiments in docs/results/experiments")
    assert list(tmp_path.iterdir()) == []
