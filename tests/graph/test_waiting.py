"""Nodes that are started alone say what they wait for, and what would bring it."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rled_agent.nodes.graph_env import GraphEnv
from rled_msgs_py.errors import RledError
from rled_msgs_py.processes import Child, Children, program

from ..web.conftest import free_port
from .conftest import Observer
from .programs import WAIT_TIMEOUT

SIM = "start sim_node in ROS_DOMAIN_ID {domain}"
ALONE = {
    "agent_node": ("rled_agent", "waiting for task_description, robot_description, joint_states"),
    "watch_episodes": ("rled_agent", "waiting for joint_states: "),
    "teleop_kinesthetic": ("rled_teleop", "waiting for task_description and robot_description: "),
    "teleop_gamepad": ("rled_teleop", "waiting for task_description and robot_description: "),
    "teleop_scripted": ("rled_teleop", "waiting for task_description and robot_description: "),
    "record_demos": ("rled_teleop", "waiting for robot_description, task_description: "),
    "teleop_web": ("rled_teleop", "waiting for task_description and joint_states: "),
}
"""Package, and what each says first in an empty graph."""
BESIDE = {
    "teleop_kinesthetic": ("rled_teleop", "waiting for device/joint_states: start the driver of the device, or"),
    "teleop_gamepad": ("rled_teleop", "waiting for joy: start joy_node, or this with --device auto,"),
    "teleop_scripted": ("rled_teleop", "waiting for 9 subscribers of joint_delta ("),
    "record_demos": ("rled_teleop", "waiting for record_demos/record: press b in teleop_keyboard, 'Begin episode'"),
    "watch_episodes": ("rled_agent", "waiting for the next tick: start agent_node or an operator"),
}
"""The same beside a simulation that waits for an answer."""


@pytest.fixture
def options(planar_expert: Path, tmp_path: Path) -> dict[str, list[str]]:
    return {
        "agent_node": ["--expert", str(planar_expert)],
        "watch_episodes": ["--output", str(tmp_path / "watched")],
        "record_demos": ["--output", str(tmp_path / "bag"), "--paused"],
        "teleop_web": ["--port", str(free_port())],
        "teleop_scripted": ["--wait-for-subscribers", "9"],
        "teleop_kinesthetic": ["--beside-agent"],
        "teleop_gamepad": ["--beside-agent"],
    }


@contextmanager
def all_of(named: dict[str, tuple[str, str]], options: dict[str, list[str]]) -> Iterator[dict[str, Child]]:
    with Children() as children:
        yield {
            name: children.start([*program(package, name), *options.get(name, [])], echo=False)
            for name, (package, _) in named.items()
        }


def await_said(running: dict[str, Child], said: dict[str, str]) -> None:
    def missing() -> list[str]:
        return [
            name for name, child in running.items() if not any(said[name] in line for line in list(child.last_lines))
        ]

    deadline = time.monotonic() + WAIT_TIMEOUT
    while missing():
        lines = {name: list(running[name].last_lines) for name in missing()}
        assert time.monotonic() < deadline, lines
        assert not any(child.exit_code for child in running.values()), lines
        time.sleep(0.05)


def test_alone_each_says_what_to_start_and_where(ros_domain: int, options: dict[str, list[str]]) -> None:
    with all_of(ALONE, options) as running:
        await_said(running, {name: text for name, (_, text) in ALONE.items()})
        await_said(running, dict.fromkeys(running, SIM.format(domain=ros_domain)))


def test_a_replay_says_whom_it_waits_for(planar_bag: Path) -> None:
    waits = {"replay_demos": ("rled_teleop", "")}
    with all_of(waits, {"replay_demos": [str(planar_bag), "--wait-for-subscribers", "7"]}) as running:
        await_said(running, {"replay_demos": "waiting for 7 subscribers of joint_delta ("})


def test_training_live_says_what_it_listens_for(tmp_path: Path) -> None:
    waits = {"train_expert": ("rled_agent", "")}
    with all_of(waits, {"train_expert": ["--live", "--output", str(tmp_path)]}) as running:
        await_said(running, {"train_expert": "waiting for a demonstration: start "})


def test_an_environment_over_the_graph_says_what_it_waits_for(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RledError, match="waited 3 s for a simulation"):
        GraphEnv("nobody", timeout=3.0)
    assert "waiting for a simulation: start sim_node in ROS_DOMAIN_ID" in capfd.readouterr().err


# Stands last: the simulation stays.
def test_beside_a_simulation_each_says_what_is_still_missing(
    observer: Observer, children: Children, options: dict[str, list[str]]
) -> None:
    with all_of(BESIDE, options) as running:
        await_said(running, {name: text for name, (_, text) in BESIDE.items()})
