"""Errors a person can act on, and how a command line ends on one."""

import functools
import os
import select
import shlex
import sys
from collections.abc import Callable
from pathlib import Path


class RledError(Exception):
    """Root of the errors that a user can cause and mend.

    Args:
        what: the offender, named ("joint 'elbow' is missing from joint_delta").
        accepted: what would have been taken ("panda_joint1 .. panda_joint7").
        remedy: what to do about it.
    """

    def __init__(self, what: str, accepted: str = "", remedy: str = "") -> None:
        self.what, self.accepted, self.remedy = what, accepted, remedy
        parts = [what, f"accepted: {accepted}" if accepted else "", remedy]
        super().__init__("; ".join(part for part in parts if part))

    def __reduce__(self) -> tuple[type, tuple[str, str, str]]:
        return type(self), (self.what, self.accepted, self.remedy)


class ContractError(RledError):
    """A record, a message or a description that breaks the contract."""


def command(*words: str | Path) -> str:
    """A command to paste into a shell, as in a remedy: ``command("demos", "repair", path)``."""
    return shlex.join(f"./{word}" if isinstance(word, Path) and str(word)[0] == "-" else str(word) for word in words)


def command_line(main: Callable[[], None]) -> Callable[[], None]:
    """Wrap a command's ``main``: a user's mistake or a full disk prints one line and exits with 2, Ctrl-C with 130.

    Where nobody reads the output any more, as behind ``| head``, it ends without a word and with 141, as ``SIGPIPE``
    ends other programs.
    """

    @functools.wraps(main)
    def wrapped() -> None:
        try:
            main()
            sys.stdout.flush()
        except (RledError, OSError) as error:
            if isinstance(error, BrokenPipeError) and _nobody_reads():
                sys.exit(141)
            print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
            sys.exit(2)
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            sys.exit(130)

    return wrapped


def _nobody_reads() -> bool:
    """Whether standard output is the pipe that broke; what is still to be written to it is dropped then."""
    poll = select.poll()
    poll.register(sys.stdout, 0)
    gone = any(event & select.POLLERR for _, event in poll.poll(0))
    if gone:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return gone
