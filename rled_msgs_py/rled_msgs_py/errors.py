"""Errors a person can act on, and how a command line ends on one."""

import functools
import os
import select
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn, TextIO

MAX_LENGTH = 1000
"""Characters of what an error quotes; names and values of other processes may have millions."""


def shortened(text: str, limit: int = MAX_LENGTH) -> str:
    """The text, its middle left out where it is longer than ``limit``."""
    return text if len(text) <= limit else f"{text[: limit // 2]} ... {text[-limit // 4 :]}"


def one_line(text: str) -> str:
    """The text without its line ends and with other control characters as escapes; a path may have several spaces."""
    line = " ".join(filter(None, map(str.strip, text.splitlines())))
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in line)


class RledError(Exception):
    """Root of the errors that a user can cause and mend.

    Args:
        what: the offender, named ("joint 'elbow' is missing from joint_delta").
        accepted: what would have been taken ("panda_joint1 .. panda_joint7").
        remedy: what to do about it.
    """

    def __init__(self, what: str, accepted: str = "", remedy: str = "") -> None:
        self.what, self.accepted, self.remedy = shortened(what), shortened(accepted), remedy
        parts = [self.what, f"accepted: {self.accepted}" if accepted else "", remedy]
        super().__init__("; ".join(part for part in parts if part))

    def __reduce__(self) -> tuple[type, tuple[str, str, str]]:
        return type(self), (self.what, self.accepted, self.remedy)


class ContractError(RledError):
    """A record, a message or a description that breaks the contract."""


def command(*words: str | Path) -> str:
    """A command to paste into a shell, as in a remedy: ``command("demos", "repair", path)``."""
    return shlex.join(f"./{word}" if isinstance(word, Path) and str(word)[0] == "-" else str(word) for word in words)


class Unreadable(ContractError):
    """Bytes that are no message of their topic, or more of them than such a message can have."""


def command_line(main: Callable[[], None]) -> Callable[[], None]:
    """Wrap a command's ``main``: a user's mistake or a full disk prints one line and exits with 2, Ctrl-C with 130.

    Where nobody reads the output any more, as behind ``| head``, it ends without a word and with 141, as ``SIGPIPE``
    ends other programs.
    """

    @functools.wraps(main)
    def wrapped() -> None:
        try:
            _flushed(main)
        except (RledError, OSError, UnicodeError, MemoryError) as error:
            if isinstance(error, BrokenPipeError) and _nobody_reads():
                sys.exit(141)
            _end(f"error: {one_line(str(error)) or 'out of memory'}", 2)
        except KeyboardInterrupt:
            _end("interrupted", 130)

    return wrapped


def _flushed(main: Callable[[], None]) -> None:
    try:
        main()
    except SystemExit:  # after --help, say
        sys.stdout.flush()
        raise
    sys.stdout.flush()


def _end(line: str, code: int) -> NoReturn:
    """Say a last line and exit; what a stream does not take is dropped, or the interpreter would complain of it."""
    for stream, text in ((sys.stdout, ""), (sys.stderr, f"{line}\n")):
        try:
            stream.write(text)
            stream.flush()
        except OSError:
            _drop(stream)
    sys.exit(code)


def _nobody_reads() -> bool:
    """Whether standard output is the pipe that broke; what is still to be written to it is dropped then."""
    poll = select.poll()
    poll.register(sys.stdout, 0)
    gone = any(event & select.POLLERR for _, event in poll.poll(0))
    if gone:
        _drop(sys.stdout)
    return gone


def _drop(stream: TextIO) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
