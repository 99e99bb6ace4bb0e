"""Connections to PyBullet, each a simulation of its own."""

import contextlib
import os
import sys
import tempfile
import weakref
from pathlib import Path

import pybullet
from rled_msgs_py.errors import RledError


class Client:
    """A simulation of PyBullet's, which ends with this object.

    Attributes:
        number: by which PyBullet's functions know it; negative when it is closed.
    """

    def __init__(self, gui: bool) -> None:
        """Connect.

        Args:
            gui: show PyBullet's window.

        Raises:
            RledError: no window can be opened.
        """
        if gui and not has_display():
            raise RledError("no display for PyBullet's window", "an X display in DISPLAY", "leave the window out")
        self.number = int(pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT))
        self._end = weakref.finalize(self, _disconnect, self.number, os.getpid())

    @property
    def is_open(self) -> bool:
        """It was not closed."""
        return self.number >= 0

    def close(self) -> None:
        """End the simulation; a second call does nothing."""
        self._end()
        self.number = -1  # PyBullet gives the old one to another client

    def saved(self) -> bytes:
        """Positions, velocities and contacts of all bodies, as PyBullet writes them."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "state.bullet")
            pybullet.saveBullet(str(path), physicsClientId=self.number)
            return path.read_bytes()

    def restore(self, saved: bytes) -> None:
        """Have the state that another client with the same bodies has saved."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "state.bullet")
            path.write_bytes(saved)
            pybullet.restoreState(fileName=str(path), physicsClientId=self.number)


def has_display() -> bool:
    """Whether a window can be opened; PyBullet ends the process where it cannot."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY"))


def _disconnect(client: int, process: int) -> None:
    """Free a client's memory; a forked process leaves alone what is its parent's."""
    if os.getpid() == process:
        with contextlib.suppress(pybullet.error):  # its window was closed by hand
            pybullet.disconnect(client)
