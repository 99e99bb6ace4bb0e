"""The word that opens the page: from an option, which the list of processes shows, a file or the environment."""

import os
import stat
from collections.abc import MutableMapping
from pathlib import Path
from shlex import quote
from typing import NamedTuple
from urllib.parse import quote as percent

from rled_msgs_py.errors import RledError, command
from rled_msgs_py.untrusted import read_text

from rled_teleop.web.params import WebParams

VARIABLE = "RLED_TOKEN"
MAX_TOKEN_LENGTH = 1000
"""Characters of a token."""


class Token(NamedTuple):
    """A word and where it came from.

    Attributes:
        word: empty for none.
        place: in words; empty for an option, which everybody sees anyway.
        warning: what is wrong about the place; empty for nothing.
    """

    word: str = ""
    place: str = ""
    warning: str = ""

    @property
    def query(self) -> str:
        """What follows the address of the page, without telling what is kept in a safe place."""
        if not self.word:
            return ""
        return f"?token=WORD (WORD: {self.place})" if self.place else f"?token={percent(self.word, safe='')}"


def given_token(params: WebParams, environment: MutableMapping[str, str] = os.environ) -> Token:
    """The token that the page is started with; it is taken out of the environment, which children inherit.

    Raises:
        RledError: two are given, the file cannot be read, or the word could not be typed.
    """
    from_environment = environment.pop(VARIABLE, "")
    if params.token and params.token_file:
        raise RledError("--token and --token-file are given", "one of them", "leave out --token")
    if params.token:
        found = Token(params.token)
    elif params.token_file:
        found = _read(Path(params.token_file).expanduser())
    else:
        found = Token(from_environment, f"the value of {VARIABLE}")
    if not found.word.isprintable() or len(found.word) > MAX_TOKEN_LENGTH:
        raise RledError(
            "the token is no word", f"one line of {MAX_TOKEN_LENGTH} characters at most", "openssl rand -hex 16"
        )
    return found


def _read(path: Path) -> Token:
    try:
        word = read_text(path, f"the token file {path}", 4 * MAX_TOKEN_LENGTH).strip()
        is_open = path.stat().st_mode & stat.S_IROTH
    except OSError as error:
        remedy = _made(path) if isinstance(error, FileNotFoundError) else "name another file"
        raise RledError(f"no token in {path}: {error.strerror}", "a file with one word", remedy) from None
    if not word:
        raise RledError(f"no token in {path}: it is empty", "a file with one word", _made(path))
    warning = f"all users can read the token in {path}; to keep it: {command('chmod', '600', path)}" if is_open else ""
    return Token(word, f"in {path}", warning)


def _made(path: Path) -> str:
    """How to make such a file."""
    folder = "" if path.parent.is_dir() else f"{command('mkdir', '-p', path.parent)} && "
    return f"{folder}umask 077 && openssl rand -hex 16 > {quote(str(path))}"
