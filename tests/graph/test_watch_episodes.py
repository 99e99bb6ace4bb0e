"""The command that watches a running graph, beside a simulation and an agent in processes of their own."""

import json
import signal
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from rled_msgs_py.processes import Children, program
from std_srvs.srv import SetBool

EPISODES = 3
WAIT_TIMEOUT = 60.0


def command(*arguments: object) -> list[str]:
    return [*program("rled_agent", "watch_episodes"), *map(str, arguments)]


def watched(output: Path, *arguments: object) -> list[dict[str, Any]]:
    """The episodes that the command has seen."""
    subprocess.run(command("--episodes", EPISODES, "--output", output, *arguments), check=True, timeout=WAIT_TIMEOUT)
    assert (output / "paths.png").read_bytes()[:4] == b"\x89PNG"
    report = json.loads((output / "episodes.json").read_text())
    assert report["episodes"] == len(report["each"]) == EPISODES
    episodes: list[dict[str, Any]] = report["each"]
    return episodes


@pytest.fixture(scope="module")
def driven(observer, children: Children, planar_expert: Path):
    """The observer of a graph in which the expert drives."""
    children.start([*program("rled_agent", "agent_node"), "--expert", str(planar_expert)])
    observer.wait_ticks(10)
    return observer


def test_episodes_of_a_seed_are_the_same_each_time(driven, tmp_path: Path) -> None:
    one, again, other = (watched(tmp_path / str(k), "--seed", seed) for k, seed in enumerate((5, 5, 6)))
    assert one == again
    assert one != other


def test_without_a_seed_it_leaves_the_graph_alone(driven, tmp_path: Path) -> None:
    begun = len(driven.ticks)
    watched(tmp_path)
    driven.wait_ticks(1)
    ticks = driven.ticks[begun:]
    changes = [(before.status, after.status) for before, after in pairwise(ticks)]
    assert all(old.terminated or old.truncated for old, new in changes if old.episode != new.episode)


def test_a_refused_reset_is_said(driven, tmp_path: Path) -> None:
    driven.call(SetBool, "sim/estop", data=True)
    try:
        done = subprocess.run(
            command("--seed", 1, "--output", tmp_path), capture_output=True, text=True, timeout=WAIT_TIMEOUT
        )
    finally:
        driven.call(SetBool, "sim/estop", data=False)
    assert done.returncode == 2
    said = done.stderr.splitlines()[-1]  # it may have waited for discovery before, and said so
    assert said == "error: the simulation refused a reset: the emergency stop is on; release it first"


def test_interrupted_while_no_simulation_answers_it_ends(observer, tmp_path: Path) -> None:
    alone = [*command("--seed", 1, "--output", tmp_path), "--ros-args", "-r", "__ns:=/nobody"]
    with subprocess.Popen(alone, stderr=subprocess.PIPE, text=True) as process:
        nodes = observer.node.get_node_names_and_namespaces
        observer.wait(lambda: ("watch_episodes", "/nobody") in nodes(), "the command")
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=WAIT_TIMEOUT) == 130
        assert process.stderr is not None
        assert process.stderr.read().splitlines()[-1] == "interrupted"
