"""A plain terminal: keys one by one without echo, a screen redrawn in place, and everything as before at the end."""

import os
import select
import sys
import termios
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rled_msgs_py.errors import RledError

ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
HIDE_CURSOR, SHOW_CURSOR, TO_LINE_END, DOWN_CLEARED = "\x1b[?25l", "\x1b[?25h", "\x1b[K", "\x1b[J"
OFF = b"\0"
"""Stands for no character (_POSIX_VDISABLE on Linux)."""


class TerminalGone(RledError):
    """The terminal was closed."""


def split_keys(text: str) -> list[str]:
    """Names of the keys in what a terminal sent: characters, and ``up``, ``down``, ``right``, ``left``.

    Other escape sequences become the key ``escape``, which nothing is mapped to.
    """
    keys, place = list[str](), 0
    while place < len(text):
        if text[place] != "\x1b":
            keys.append(text[place])
            place += 1
            continue
        place += 1
        if text[place : place + 1] not in ("[", "O"):
            keys.append("escape")
            continue
        end = place + 1
        while end < len(text) and not "\x40" <= text[end] <= "\x7e":
            end += 1
        keys.append(ARROWS.get(text[place + 1 : end + 1], "escape"))
        place = end + 1
    return keys


class Screen:
    """Keys from a terminal, lines onto it.

    Args:
        keys: file descriptor to read from.
        output: file descriptor to draw on.
    """

    def __init__(self, keys: int, output: int) -> None:
        self._keys, self._output = keys, output
        self._drawn: list[str] = []

    def read(self) -> list[str]:
        """The keys that arrived since the last call; does not wait.

        Raises:
            TerminalGone: nobody can press a key any more.
        """
        text = b""
        while select.select([self._keys], [], [], 0)[0]:
            try:
                part = os.read(self._keys, 1024)
            except OSError:
                part = b""
            if not part:
                raise TerminalGone("the terminal was closed")
            text += part
        return split_keys(text.decode(errors="replace"))

    def draw(self, lines: Sequence[str]) -> None:
        """Show lines in the place of those shown before; the same ones cost nothing."""
        if list(lines) == self._drawn:
            return
        up = f"\x1b[{len(self._drawn)}A" if self._drawn else ""
        width = self._width()
        body = "".join(f"\r{line[: width - 1]}{TO_LINE_END}\n" for line in lines)
        self._write(f"{up}{body}{DOWN_CLEARED}")
        self._drawn = list(lines)

    def _width(self) -> int:
        try:
            return os.get_terminal_size(self._output).columns or 80
        except OSError:
            return 80

    def _write(self, text: str) -> None:
        os.write(self._output, text.encode())


@contextmanager
def keyboard_screen() -> Iterator[Screen]:
    """The terminal of this process, without line buffering and echo; as it was before when the block ends.

    Ctrl-C still interrupts. Suspend and quit are keys like others: they would leave the terminal as it is here.

    Raises:
        RledError: standard input is no terminal.
    """
    keys = sys.stdin.fileno()
    try:
        before = termios.tcgetattr(keys)
    except termios.error:
        raise RledError("standard input is no terminal", "a terminal", "start it in a terminal of its own") from None
    output = sys.stdout.fileno()
    now = termios.tcgetattr(keys)
    now[3] &= ~(termios.ICANON | termios.ECHO)
    for key in (termios.VSUSP, termios.VQUIT):
        now[6][key] = OFF
    now[6][termios.VMIN], now[6][termios.VTIME] = 1, 0
    termios.tcsetattr(keys, termios.TCSADRAIN, now)
    try:
        os.write(output, HIDE_CURSOR.encode())
        yield Screen(keys, output)
    finally:
        try:
            termios.tcsetattr(keys, termios.TCSADRAIN, before)
            os.write(output, SHOW_CURSOR.encode())
        except (termios.error, OSError):
            pass  # the terminal is gone
