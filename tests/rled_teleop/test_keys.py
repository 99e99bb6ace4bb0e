"""What keys mean, without a terminal: deadman, speed, requests."""

import contextlib
import fcntl
import os
import pty
import re
import select
import string
import struct
import termios

import numpy as np
import pytest
from rled_msgs_py.errors import RledError
from rled_teleop.operators.jog import Jog
from rled_teleop.operators.keyboard_screen import HELP, RULE, ScreenState, screen, waiting_screen
from rled_teleop.operators.keys import FASTER, LINEAR, REQUESTS, SLOWER, TURNS, Keyboard, Request
from rled_teleop.operators.terminal import Screen, TerminalGone, fitted, keyboard_screen, split_keys

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


@pytest.mark.parametrize("key", ["0", "3", "9"])
def test_a_digit_without_a_joint_stops_and_is_answered_until_the_next_key(keyboard, jog, task, arm, key):
    keyboard.press("2", 0.0)
    keyboard.press("right", 0.0)
    keyboard.press(key, 0.0)
    assert keyboard.joint == 1
    assert keyboard.delta(jog, Q, 0.0) is None
    shown = ScreenState(task, arm.tick(), keyboard.motion(0.0), None, "")
    assert f"there is no joint {key}: 1 to 2" in "\n".join(screen(keyboard, shown))
    keyboard.press("1", 0.0)
    assert "no joint" not in "\n".join(screen(keyboard, shown))
    for no_digit in ("³", "٣", "९"):
        keyboard.press(no_digit, 0.0)
        assert keyboard.joint == 0
        assert not keyboard.refused


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


def test_escape_sequences_are_one_key():
    for sent, keys in [
        ("wd", ["w", "d"]),
        ("\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"]),
        ("\x1bOA", ["up"]),
        ("\x1b[1;5C", ["escape"]),
        ("\x1b", ["escape"]),
        ("\x1bx", ["escape", "x"]),
        ("\x1b[", ["escape"]),
        ("w\x1b[15~d", ["w", "escape", "d"]),
    ]:
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


def sent(master):
    """What the terminal was sent until now."""
    text = b""
    while select.select([master], [], [], 0)[0]:
        text += os.read(master, 100_000)
    return text.decode()


def resized(slave, rows, columns):
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))


class Emulator:
    """A terminal of some rows: what is on it, and what has scrolled out of it."""

    def __init__(self, rows):
        self.rows, self.lines, self.row, self.scrolled = rows, [""] * rows, 0, []

    def feed(self, text):
        for up, code, letter in re.findall(r"\x1b\[(\d+)A|(\x1b\[[?\d]*[a-zA-Z])|(.)", text, re.DOTALL):
            if up:
                self.row = max(self.row - int(up), 0)
            elif code == "\x1b[H":
                self.row, self.lines[0] = 0, ""
            elif code == "\x1b[J":
                kept = self.row + (self.rows == 1)
                self.lines[kept:] = [""] * (self.rows - kept)
            elif letter == "\r":
                self.lines[self.row] = ""
            elif letter == "\n" and self.row == self.rows - 1:
                self.scrolled.append(self.lines.pop(0))
                self.lines.append("")
            elif letter == "\n":
                self.row += 1
            elif letter:
                self.lines[self.row] += letter


def test_a_terminal_of_any_size_is_never_scrolled_and_shows_the_newest(terminal, keyboard, task, arm):
    for rows in [*range(1, 13), 24]:
        for columns in [1, 2, 20, 80]:
            master, slave = terminal
            resized(slave, rows, columns)
            drawn, shown = Emulator(rows), Screen(slave, slave)
            for number in range(5):
                lines = [f"{number} {line}" for line in screen(keyboard, ScreenState(task, arm.tick(), None, None, ""))]
                shown.draw(lines)
                drawn.feed(sent(master).replace("\r\n", "\n"))
            seen = [line for line in drawn.lines if line]
            assert drawn.scrolled == []
            assert seen == ([line[: columns - 1] for line in lines[: max(rows - 1, 1)]] if columns > 1 else [])


def test_what_does_not_fit_are_rules_first_and_then_the_help(keyboard, task, arm):
    lines = screen(keyboard, ScreenState(task, arm.tick(), None, None, "ready"))
    assert fitted(lines, len(lines)) == lines
    assert fitted(lines, 6) == [line for line in lines if line not in (RULE, *HELP)]


def test_a_terminal_that_was_resized_is_drawn_anew_from_its_top(terminal):
    master, slave = terminal
    shown = Screen(slave, slave)
    for rows, columns, begin in ((24, 80, "\ra"), (8, 80, "\x1b[H\ra"), (8, 20, "\x1b[H\ra")):
        resized(slave, rows, columns)
        shown.draw(["a", "b"])
        assert sent(master).startswith(begin)
    shown.draw(["a", "c"])
    assert sent(master).startswith("\x1b[2A\ra")


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
    shown = ScreenState(task, arm.tick(), keyboard.motion(0.0), np.array([0.025, 0.0]), "recording")
    text = "\n".join(screen(keyboard, shown))
    assert "turning shoulder +" in text
    assert "speed 25 %" in text
    assert "largest step 0.0250 of 0.1 rad" in text
    assert "recorder: recording" in text
    assert "waiting" in "\n".join(waiting_screen("task_description", ""))
