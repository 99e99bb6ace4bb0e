"""A terminal with an operator in it."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time
from collections.abc import Callable
from typing import IO

from rled_msgs_py.processes import program

from .programs import WAIT_TIMEOUT

ROWS, COLUMNS = 24, 100


class Terminal:
    """A terminal with the keyboard operator in it: presses keys, keeps what the screen shows."""

    def __init__(self, *arguments: str, errors: IO[str] | int = subprocess.PIPE) -> None:
        self.master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
        self.before = termios.tcgetattr(self.slave)
        command = [*program("rled_teleop", "teleop_keyboard"), *arguments]
        self.process = subprocess.Popen(
            command, stdin=self.slave, stdout=self.slave, stderr=errors, text=True, start_new_session=True
        )
        self.lines: list[str] = []
        self._row = 0

    def press(self, keys: str) -> None:
        os.write(self.master, keys.encode())

    def look(self, patience: float = 0.05) -> str:
        """What the screen shows now."""
        while select.select([self.master], [], [], patience)[0]:
            self._show(os.read(self.master, 65536).decode(errors="replace"))
            patience = 0.0
        return "\n".join(self.lines)

    def await_that(self, condition: Callable[[str], object], what: str, pressing: str = "") -> str:
        """Look until the screen meets a condition, pressing keys all the while."""
        deadline = time.monotonic() + WAIT_TIMEOUT
        while not condition(text := self.look()):
            assert self.process.poll() is None, self.process.communicate()[1]
            assert time.monotonic() < deadline, f"waited in vain for {what}:\n{text}"
            self.press(pressing)
        return text

    def _show(self, text: str) -> None:
        for up, line in re.findall(r"\x1b\[(\d+)A|([^\n]*)\n", text):
            if up:
                self._row -= int(up)
                continue
            self.lines += [""] * (self._row + 1 - len(self.lines))
            self.lines[self._row] = re.sub(r"\x1b\[[?\d]*[a-zA-Z]|\r", "", line)
            self._row += 1

    def end(self, number: int | None = None) -> int:
        if number is not None:
            self.process.send_signal(number)
        deadline = time.monotonic() + WAIT_TIMEOUT
        while self.process.poll() is None and time.monotonic() < deadline:
            self.look()
        return self.process.wait(timeout=1.0)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
        os.close(self.master)
        os.close(self.slave)
