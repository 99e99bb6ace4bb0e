"""Child processes: each printed as a person would type it, watched while it runs, ended with its parent."""

import contextlib
import ctypes
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import IO

from rled_msgs_py.errors import RledError

LAST_LINES = 20
POLL_PERIOD = 0.01
END_TIMEOUTS = {signal.SIGINT: 15.0, signal.SIGTERM: 2.0}
"""Seconds that a child is given to end after each signal, before SIGKILL."""

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def program(package: str, name: str) -> list[str]:
    """How to start an executable of one of our packages, as a command line.

    It is looked for beside the running interpreter (pip), then in the workspaces sourced (colcon); last, the module of
    that name in the package, in whatever folder, is run.
    """
    workspaces = [Path(each, "lib", package) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if each]
    for folder in (Path(sys.executable).parent, *workspaces):
        if (folder / name).is_file():
            return [_short(folder / name)]
    return [_short(Path(sys.executable)), "-m", _module(package, name)]


def _module(package: str, name: str) -> str:
    spec = find_spec(package)
    for folder in (spec and spec.submodule_search_locations) or ():
        for path in sorted(Path(folder).rglob(f"{name}.py")):
            return ".".join([package, *path.relative_to(folder).with_suffix("").parts])
    return f"{package}.{name}"


def _short(path: Path) -> str:
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)


@dataclass(frozen=True, eq=False)
class Child:
    """A running child process.

    Attributes:
        name: what it is called in messages.
        process: the process, leader of a process group of its own.
        last_lines: the end of what it printed; empty when it writes to this terminal itself.
    """

    name: str
    process: "subprocess.Popen[str]"
    last_lines: deque[str] = field(default_factory=lambda: deque(maxlen=LAST_LINES))

    @property
    def exit_code(self) -> int | None:
        """None while it runs."""
        return self.process.poll()


class Children:
    """Context manager that starts command lines and ends them all: SIGINT, then SIGTERM, then SIGKILL.

    Each child leads a process group, so that Ctrl-C reaches only the parent and the children end in order; children
    of children are ended with them. A child is told to end when its parent is killed.
    """

    def __init__(self) -> None:
        self._children: list[Child] = []
        self._readers: dict[Child, threading.Thread] = {}

    def __enter__(self) -> "Children":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def start(
        self,
        command: Sequence[str],
        *,
        env: Mapping[str, str] | None = None,
        capture: bool = True,
        echo: bool = True,
        files: Sequence[int] = (),
    ) -> Child:
        """Print a command line and start it.

        Args:
            command: program and arguments.
            env: variables added to this process's environment.
            capture: keep its last lines; otherwise it writes to this terminal itself (for progress bars).
            echo: print what it prints, each line led by its name.
            files: descriptors of open files that the child has too.

        Raises:
            RledError: there is no such program.
        """
        assignments = [f"{key}={shlex.quote(value)}" for key, value in (env or {}).items()]
        print(" ".join(["$", *assignments, shlex.join(command)]) + "\n", end="", flush=True)  # whole beside others
        child = Child(_name(command), _spawn(command, env or {}, capture, files))
        self._children.append(child)
        if child.process.stdout is not None:
            reader = threading.Thread(target=_read, args=(child, child.process.stdout, echo), daemon=True)
            self._readers[child] = reader
            reader.start()
        return child

    def check(self) -> None:
        """See that no child has failed.

        Raises:
            RledError: one ended with another code than 0; its last lines are in the message.
        """
        for child in self._children:
            if child.exit_code:
                raise self._failure(child)

    def wait(self, child: Child, timeout: float | None = None) -> None:
        """Wait until a child has ended with code 0; all others must go on meanwhile, or end with code 0 too.

        Raises:
            RledError: a child failed, or this one took longer than ``timeout`` seconds.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while child.exit_code is None:
            self.check()
            if deadline is not None and time.monotonic() > deadline:
                raise RledError(f"{child.name} still runs after {timeout:g} s")
            time.sleep(POLL_PERIOD)
        self._settle(child)
        self.check()

    def end(self, *chosen: Child) -> None:
        """End the chosen children, all of them by default, and their process groups."""
        ended = [child for child in chosen or tuple(reversed(self._children)) if child.exit_code is None]
        for number, seconds in END_TIMEOUTS.items():
            running = [child for child in ended if child.exit_code is None]
            for child in running:
                _signal_group(child, number)
            _await(running, seconds)
        for child in ended:
            _signal_group(child, signal.SIGKILL)  # it, or what it left behind in its group
            child.process.wait()
            self._settle(child)

    def _settle(self, child: Child) -> None:
        if reader := self._readers.get(child):
            reader.join(timeout=1.0)

    def _failure(self, child: Child) -> RledError:
        self._settle(child)
        said = " | ".join(line for line in child.last_lines if line.strip())
        code = child.exit_code
        how = f"by signal {signal.Signals(-code).name}" if code and code < 0 else f"with exit code {code}"
        return RledError(f"{child.name} ended {how}" + (f": {said}" if said else ""))


def _name(command: Sequence[str]) -> str:
    module = command.index("-m") + 1 if "-m" in command else 0
    return Path(command[module]).name.rpartition(".")[2]


def _prepare() -> None:
    """In the child: it dies with its parent, and hears SIGINT although its parent may not, as one behind ``nohup``."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _spawn(
    command: Sequence[str], env: Mapping[str, str], capture: bool, files: Sequence[int]
) -> "subprocess.Popen[str]":
    try:
        return subprocess.Popen(
            command,
            env={**os.environ, "PYTHONUNBUFFERED": "1", **({"PYTHONIOENCODING": "utf-8"} if capture else {}), **env},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if capture else None,
            stderr=subprocess.STDOUT if capture else None,
            encoding="utf-8",
            errors="replace",
            process_group=0,
            preexec_fn=_prepare,
            pass_fds=files,
        )
    except OSError as error:
        raise RledError(f"{command[0]} does not start: {error.strerror}", "", "run make setup") from None


def _read(child: Child, output: IO[str], echo: bool) -> None:
    for line in output:
        child.last_lines.append(line.rstrip())
        if echo:
            print(f"[{child.name}] {line.rstrip()}", flush=True)


def _signal_group(child: Child, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.process.pid, number)


def _await(children: Sequence[Child], seconds: float) -> None:
    deadline = time.monotonic() + seconds
    while any(child.exit_code is None for child in children) and time.monotonic() < deadline:
        time.sleep(POLL_PERIOD)
