"""How the commands of all packages start: Ctrl-C ends them cleanly while their imports are still under way.

``setup.py`` names a command as ``rled_msgs_py.starting:MODULE``, with dots and all. This file imports next to nothing,
so that it is soon there, and then the module, which may take seconds.
"""

import os
import signal
import sys
from importlib import import_module

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


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
    before = signal.signal(signal.SIGINT, _end)
    main = import_module(module).main
    signal.signal(signal.SIGINT, before)
    main()


def _end(*_: object) -> None:
    """End at once: nothing was begun. An exception in the middle of an import may be swallowed, or be shown."""
    print("interrupted", file=sys.stderr, flush=True)
    os._exit(INTERRUPTED)
