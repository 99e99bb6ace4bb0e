"""The keyboard operator in a pseudo-terminal of its own, driving a simulation and a recorder in other processes."""

import json
import re
import signal
import subprocess
import termios
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from rled_msgs_py.bags import Bag
from rled_msgs_py.processes import program
from rled_msgs_py.topics import EPISODE_EVENTS, JOINT_DELTA, JOINT_STATES, MARKED_JOINT_STATES
from rled_teleop.operators.keyboard_screen import HELP

from .programs import WAIT_TIMEOUT, planar_simulation, running
from .terminal import Terminal


def joints(text: str) -> np.ndarray:
    (line,) = (line for line in text.splitlines() if line.startswith("joints"))
    return np.array([float(number) for number in re.findall(r"[+-]\d+\.\d+", line)])


def seconds(text: str) -> float:
    found = re.search(r" t +(\d+\.\d+) s", text)
    return float(found[1]) if found else 0.0


def is_there(text: str) -> bool:
    return "planar" in text


@pytest.mark.parametrize("mode", ["real_time", "lockstep"])
def test_a_held_key_turns_the_joint_and_letting_go_stops_it(mode: str) -> None:
    with planar_simulation(mode), closing(Terminal()) as terminal:
        start = joints(terminal.await_that(is_there, "the robot"))
        terminal.await_that(lambda text: joints(text)[1] > start[1] + 0.3, "the elbow to open", pressing="2\x1b[C")
        rest = terminal.await_that(lambda text: "still" in text, "rest")
        still = terminal.await_that(lambda text: seconds(text) > seconds(rest) + 0.1, "the last step to be seen")
        later = terminal.await_that(lambda text: seconds(text) > seconds(still) + 0.5, "time to pass")
        np.testing.assert_array_equal(joints(later), joints(still))
        assert joints(later)[0] == pytest.approx(start[0], abs=1e-3)
        terminal.press("Q")
        assert terminal.end() == 0
        assert termios.tcgetattr(terminal.slave) == terminal.before


def test_lockstep_is_no_faster_than_real_time() -> None:
    with planar_simulation("lockstep"), closing(Terminal()) as terminal:
        first, began = seconds(terminal.await_that(is_there, "the robot")), time.monotonic()
        passed = seconds(terminal.await_that(lambda text: seconds(text) > first + 4.0, "four seconds")) - first
        assert passed < 1.35 * (time.monotonic() - began)


def test_keys_move_the_end_effector_change_the_speed_and_stop() -> None:
    with planar_simulation("real_time"), closing(Terminal()) as terminal:
        terminal.await_that(is_there, "the robot")
        terminal.press("+")
        terminal.await_that(lambda text: "speed 50 %" in text, "more speed")
        terminal.await_that(lambda text: "moving x -" in text, "motion", pressing="s")
        terminal.press("?")  # not mapped
        terminal.await_that(lambda text: "still" in text, "rest")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_restores_the_terminal(number: signal.Signals) -> None:
    with closing(Terminal()) as terminal:
        terminal.await_that(lambda text: "start sim_node in ROS_DOMAIN_ID" in text, "the screen")
        assert termios.tcgetattr(terminal.slave) != terminal.before
        assert terminal.end(number) == 0
        assert termios.tcgetattr(terminal.slave) == terminal.before


def test_no_terminal_is_one_line() -> None:
    command = program("rled_teleop", "teleop_keyboard")
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=WAIT_TIMEOUT)
    assert done.returncode == 2
    assert done.stderr.startswith("error: standard input is no terminal")
    assert len(done.stderr.splitlines()) == 1


def walk_through(bag: Path) -> list[str]:
    """Two episodes by keyboard beside a paused recorder, the second one discarded; returns what the screen showed."""
    recorder = running("rled_teleop", "record_demos", "--output", str(bag), "--paused", "--operator-name", "me")
    with planar_simulation("real_time"), recorder as recording, closing(Terminal()) as terminal:
        screens = [terminal.await_that(is_there, "the robot")]

        def ask(key: str, answer: str) -> None:
            """Press again and again: the recorder may be found late."""
            terminal.await_that(lambda text: answer in text or "is being recorded" in text, answer, pressing=key)
            screens.append(terminal.look())

        ask("b", "recording episode 0")
        x = joints(screens[-1])[0]
        terminal.await_that(lambda text: joints(text)[0] > x + 0.1, "the shoulder to turn", pressing=".")
        screens.append(terminal.look())
        terminal.await_that(lambda text: "moving x -" in text, "motion", pressing="s")
        screens.append(terminal.look())
        terminal.press("m")
        terminal.await_that(lambda text: "recorder: marked" in text, "a mark")
        screens.append(terminal.look())
        for key, answer in (("n", "episode 0 ended"), ("k", "episode 0 kept"), ("b", "recording episode 1")):
            terminal.press(key)
            terminal.await_that(lambda text, answer=answer: answer in text, answer)
        terminal.press("x")
        screens.append(terminal.await_that(lambda text: "episode 1 discarded" in text, "the end of it"))
        terminal.press("Q")
        assert terminal.end() == 0
        recording.send_signal(signal.SIGINT)
        assert recording.wait(timeout=WAIT_TIMEOUT) == 0
    return screens


def test_episodes_are_recorded_marked_kept_and_discarded_by_keys(tmp_path: Path) -> None:
    screens = walk_through(tmp_path / "bag")
    assert "turning shoulder +" in screens[2]
    bag = Bag(tmp_path / "bag")
    events = [json.loads(record.data) for record in bag.records(EPISODE_EVENTS)]  # type: ignore[union-attr]
    assert [(each["event"], each["episode"], each["operator"]) for each in events] == [
        ("start", 0, "me"),
        ("stop", 0, "me"),
        ("keep", 0, "me"),
        ("start", 1, "me"),
        ("stop", 1, "me"),
        ("discard", 1, "me"),
    ]
    assert len(bag.joints(MARKED_JOINT_STATES).stamps) == 1
    deltas, states = bag.joints(JOINT_DELTA), bag.joints(JOINT_STATES)
    assert np.isin(deltas.stamps, states.stamps).all()
    assert np.abs(deltas.position).max() == pytest.approx(0.025)


def test_the_documentation_shows_the_screen_as_it_is() -> None:
    text = (Path(__file__).parents[2] / "docs" / "keyboard.md").read_text()
    for line in HELP:
        assert line in text
