"""What keys mean, without a terminal: deadman, speed, requests."""

import contextlib
import os
import pty
import string
import termios

import numpy as np
import pytest
from rled_msgs_py.errors import RledError
from rled_teleop.jog import Jog
from rled_teleop.keyboard_screen import Shown, screen, waiting_screen
from rled_teleop.keys import FASTER, LINEAR, REQUESTS, SLOWER, TURNS, Keyboard, Request
from rled_teleop.terminal import Screen, TerminalGone, keyboard_screen, split_keys

Q = np.array([-0.8, 1.6])


@pytest.fixture
def jog(task, chain):
    return Jog(task, chain)


@pytest.fixture
def keyboard():
    return Keyboard(2, timeout=0.3)


def test_nothing_moves_before_a_key(keyboard, jog):
    assert keyboard.delta(jog, Q, 0.0) is None


def test_a_motion_lasts_as_long_as_its_key_arrives(keyboard, jog):
    for now in (0.0, 0.2, 0.4):
        keyboard.press("right", now)
    np.testing.assert_allclose(keyboard.delta(jog, Q, 0.69), [0.025, 0.0])
    assert keyboard.delta(jog, Q, 0.7) is None


def test_digits_choose_a_joint_and_stop(keyboard, jog):
    keyboard.press("right", 0.0)
    keyboard.press("2", 0.0)
    assert keyboard.delta(jog, Q, 0.0) is None
    keyboard.press("left", 0.0)
    np.testing.assert_allclose(keyboard.delta(jog, Q, 0.0), [0.0, -0.025])
    keyboard.press("3", 0.0)  # there is no third joint
    assert keyboard.joint == 1


def test_the_end_effector_moves_along_an_axis(keyboard, jog, chain):
    keyboard.press("a", 0.0)
    moved = chain.position(Q + keyboard.delta(jog, Q, 0.0)) - chain.position(Q)
    np.testing.assert_allclose(moved, [0.0, 0.5 * 0.25 * 0.02, 0.0], atol=1e-5)


def test_speed_keys_double_and_halve_within_bounds(keyboard):
    for _ in range(9):
        keyboard.press("+", 0.0)
    assert keyboard.share == 1.0
    keyboard.press("-", 0.0)
    assert keyboard.share == 0.5
    for _ in range(9):
        keyboard.press("-", 0.0)
    assert keyboard.share == 1 / 32


def test_every_unmapped_key_stops(keyboard, jog):
    mapped = {*REQUESTS, *LINEAR, *TURNS, *FASTER, *SLOWER}
    for key in {*string.printable, "escape", "ü", "\x1a"} - mapped:
        keyboard.press("w", 0.0)
        assert keyboard.press(key, 0.0) is None
        assert keyboard.delta(jog, Q, 0.0) is None, key


def test_requests_are_handed_back_and_stop(keyboard, jog):
    for key, request in REQUESTS.items():
        keyboard.press("w", 0.0)
        assert keyboard.press(key, 0.0) is request
        assert keyboard.delta(jog, Q, 0.0) is None
    assert set(REQUESTS.values()) == set(Request)


@pytest.mark.parametrize(
    ("sent", "keys"),
    [
        ("wd", ["w", "d"]),
        ("\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"]),
        ("\x1bOA", ["up"]),
        ("\x1b[1;5C", ["escape"]),
        ("\x1b", ["escape"]),
        ("\x1bx", ["escape", "x"]),
        ("\x1b[", ["escape"]),
        ("w\x1b[15~d", ["w", "escape", "d"]),
    ],
)
def test_escape_sequences_are_one_key(sent, keys):
    assert split_keys(sent) == keys


@pytest.fixture
def terminal():
    master, slave = pty.openpty()
    yield master, slave
    for each in (master, slave):
        with contextlib.suppress(OSError):
            os.close(each)


def test_a_screen_is_drawn_over_itself_and_only_when_it_changes(terminal):
    master, slave = terminal
    shown = Screen(slave, slave)
    shown.draw(["one", "two"])
    first = os.read(master, 1000)
    assert first.count(b"\n") == 2
    shown.draw(["one", "two"])
    shown.draw(["one", "TWO"])
    assert os.read(master, 1000).startswith(b"\x1b[2A\rone\x1b[K")


def test_a_closed_terminal_is_said(terminal):
    master, slave = terminal
    shown = Screen(slave, slave)
    assert shown.read() == []
    os.close(master)
    with pytest.raises(TerminalGone):
        shown.read()


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, RledError])
def test_the_terminal_is_as_before_on_every_way_out(terminal, monkeypatch, error):
    master, slave = terminal
    before = termios.tcgetattr(slave)
    with open(slave, closefd=False) as file:
        monkeypatch.setattr("sys.stdin", file)
        monkeypatch.setattr("sys.stdout", file)
        try:
            with keyboard_screen() as shown:
                within = termios.tcgetattr(slave)
                assert not within[3] & (termios.ICANON | termios.ECHO)
                assert within[3] & termios.ISIG
                os.write(master, b"\x1aw")
                assert shown.read() == ["\x1a", "w"]  # Ctrl-Z is a key
                if error:
                    raise error("out")
        except (KeyboardInterrupt, RledError):
            pass
    assert termios.tcgetattr(slave) == before
    drawn = b""
    while not drawn.endswith(b"\x1b[?25h"):
        drawn += os.read(master, 100)


def test_no_terminal_is_refused(monkeypatch, tmp_path):
    with (tmp_path / "file").open("w+") as file, monkeypatch.context() as patch:
        patch.setattr("sys.stdin", file)
        with pytest.raises(RledError, match="no terminal"), keyboard_screen():
            pass


def test_the_screen_says_what_moves(keyboard, task, arm):
    keyboard.press("right", 0.0)
    shown = Shown(task, arm.tick(), keyboard.motion(0.0), np.array([0.025, 0.0]), "recording")
    text = "\n".join(screen(keyboard, shown))
    assert "turning shoulder +" in text
    assert "speed 25 %" in text
    assert "largest step 0.0250 of 0.1 rad" in text
    assert "recorder: recording" in text
    assert "waiting" in "\n".join(waiting_screen("task_description", ""))
