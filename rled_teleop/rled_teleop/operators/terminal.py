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
HOME = "\x1b[H"
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


def fitted(lines: Sequence[str], rows: int) -> list[str]:
    """As many lines as a terminal has room for: rules go first, then the last ones."""
    if len(lines) > rows:
        lines = [line for line in lines if line.strip("-")]
    return list(lines[:rows])


class Screen:
    """Keys from a terminal, lines onto it.

    Args:
        keys: file descriptor to read from.
        output: file descriptor to draw on.
    """

    def __init__(self, keys: int, output: int) -> None:
        self._keys, self._output = keys, output
        self._drawn: list[str] = []
        self._drawn_at: os.terminal_size | None = None

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
        """Show lines in the place of those shown before, as many as fit; the same ones cost nothing."""
        size = self._size()
        shown = [line[: max(size.columns - 1, 0)] for line in fitted(lines, max(size.lines - 1, 1))]
        if (shown, size) == (self._drawn, self._drawn_at):
            return
        if self._drawn_at not in (None, size):  # where the lines drawn before are now, only the terminal knows
            back = HOME
        else:
            back = f"\x1b[{len(self._drawn)}A" if self._drawn and size.lines > 1 else ""
        end = "\n" if size.lines > 1 else ""  # which would scroll a single line away
        body = "".join(f"\r{line}{TO_LINE_END}{end}" for line in shown)
        self._write(f"{back}{body}{DOWN_CLEARED}")
        self._drawn, self._drawn_at = shown, size

    def _size(self) -> os.terminal_size:
        try:
            columns, rows = os.get_terminal_size(self._output)
        except OSError:
            columns, rows = 0, 0
        return os.terminal_size((columns or 80, rows or 24))

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
