"""How the commands of all packages start, wherever they are started.

``setup.py`` names a command as ``rled_msgs_py.starting:MODULE``, with dots and all. This file imports next to nothing,
so that it is soon there; it sees to Ctrl-C and to the standard streams, and then imports the module, which may take
seconds.
"""

import os
import signal
import sys
from importlib import import_module

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def _end(*_: object) -> None:
    """End at once: nothing is begun, or all is done. An exception in an import may be swallowed, or be shown."""
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)


_BEFORE = signal.signal(signal.SIGINT, _end)


class _Module:
    """A module by its name; called, it starts the command that it is."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, part: str) -> "_Module":
        return _Module(f"{self._name}.{part}")

    def __call__(self) -> None:
        _start(self._name)


def __getattr__(name: str) -> _Module:
    if not name.startswith("rled_"):
        raise AttributeError(name)
    return _Module(name)


def _start(module: str) -> None:
    from rled_msgs_py.errors import command_line

    _open_streams()
    sys.meta_path.insert(0, _BeforeRos)  # a whole class of importlib would take time that Ctrl-C has

    @command_line
    def run() -> None:
        main = import_module(module).main
        signal.signal(signal.SIGINT, _BEFORE)
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, _leave)
        try:
            main()
        finally:
            signal.signal(signal.SIGINT, _end)

    run()


def _leave(number: int, _: object) -> None:
    """End in order, with the exit code that shells give: temporary files are removed, child processes ended."""
    sys.exit(128 + number)


class _BeforeRos:
    """A finder that finds no module, but is asked before rclpy is imported."""

    @staticmethod
    def find_spec(name: str, *_: object) -> None:
        """See that rclpy can be imported."""
        if name == "rclpy":
            from rled_msgs_py.environment import require_middleware

            require_middleware()


def _open_streams() -> None:
    """Have all three streams, and let them take any text.

    An opened file gets the smallest free number: with standard output closed, the words of a command would
    go into its own files. Letters that the encoding lacks are written as their escapes.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # takes that number
    sys.stdin = sys.stdin or open(0, closefd=False)  # noqa: SIM115
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
