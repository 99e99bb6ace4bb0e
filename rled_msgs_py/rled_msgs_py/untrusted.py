"""Texts from elsewhere: size, depth and kind are bounded before they cost anything.

Whatever another program or person wrote (``metadata.yaml``, the QoS of a channel, a mapping, ``config.json``, a
description on a topic) is read here, so that no text takes more memory or time than its size explains.
"""

import json
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rled_msgs_py.errors import ContractError

MAX_TEXT = 4 << 20
"""Characters of a text; the metadata of a bag of 10,000 files have two million."""
MAX_DEPTH = 64
"""Collections within each other."""
MAX_NODES = 200_000
"""Scalars and collections, those that aliases repeat counted again."""
MAX_NUMBER = 400
"""Characters of what YAML may take for a number; one in base 60 takes time in the square of its length."""

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_NUMBER = re.compile(r"[-+.:\d_]+")


def read_text(path: Path, what: str, limit: int = MAX_TEXT) -> str:
    """The text of a file in UTF-8.

    Args:
        path: the file.
        what: its name, for the error.
        limit: maximum bytes that are read.

    Raises:
        ContractError: it is no regular file, too large, or not UTF-8.
        OSError: it cannot be read.
    """
    kind = path.stat().st_mode
    if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):  # a pipe would be waited for
        raise ContractError(f"{what} is no regular file", "a text file")
    with path.open("rb") as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise ContractError(f"{what} is too large", f"{limit} bytes at most")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise ContractError(f"{what} is not UTF-8 at byte {error.start}", "text in UTF-8") from None


def read_json(text: str, what: str) -> Any:
    """The content of a JSON text.

    Raises:
        ContractError: no JSON, too large, or nested too deeply.
    """
    _require_size(text, what)
    if sum(map(text.count, "[{,")) > MAX_NODES:
        raise ContractError(f"{what} has too many parts", f"{MAX_NODES} at most")
    try:
        found = json.loads(text)
    except RecursionError:
        raise _too_deep(what) from None
    except ValueError as error:
        raise ContractError(f"{what} is no JSON ({error})") from None
    if _depth(found) > MAX_DEPTH:
        raise _too_deep(what)
    return found


def read_yaml(text: str, what: str) -> Any:
    """The content of a YAML text, by the safe rules; None for an empty one.

    Raises:
        ContractError: no YAML, too large, nested too deeply, or its aliases expand without measure.
    """
    _require_size(text, what)
    try:
        _require_measure(yaml.parse(text, LOADER), what)
        return yaml.load(text, LOADER)
    except ContractError:
        raise
    except Exception as error:  # a wrong tag on a scalar leads PyYAML to whatever error int() or a lookup has
        reason = getattr(error, "problem", None) or type(error).__name__
        raise ContractError(f"{what} is no YAML ({reason})") from None


def _require_size(text: str, what: str) -> None:
    if len(text) > MAX_TEXT:
        raise ContractError(f"{what} is too large", f"{MAX_TEXT} characters at most")


def _too_deep(what: str) -> ContractError:
    return ContractError(f"{what} is nested too deeply", f"{MAX_DEPTH} levels at most")


def _depth(content: Any) -> int:
    depth, level = 0, [content]
    while level := [each for each in level if isinstance(each, dict | list)]:
        depth += 1
        level = [part for each in level for part in (each.values() if isinstance(each, dict) else each)]
    return depth


@dataclass
class _Opened:
    """A collection that is not complete yet: its anchor, the nodes before it, the levels within it so far."""

    anchor: str | None = None
    before: int = 0
    height: int = 0


def _require_measure(events: Iterator[Any], what: str) -> None:
    """Follow the events of a parser, which come before anything is built, and count what they would build."""
    nodes, opened, known = 0, [_Opened()], dict[str | None, tuple[int, int]]()
    for event in events:
        height = 0
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in known:
                raise ContractError(f"{what} refers to *{event.anchor}, which is not complete there")
            size, height = known[event.anchor]
            nodes += size
        elif isinstance(event, yaml.ScalarEvent):
            nodes += 1
            known[event.anchor] = (1, 0)
            if len(event.value) > MAX_NUMBER and _NUMBER.fullmatch(event.value):
                raise ContractError(f"{what} has a number of {len(event.value)} characters", f"{MAX_NUMBER} at most")
        elif isinstance(event, yaml.CollectionStartEvent):
            opened.append(_Opened(event.anchor, nodes))
            nodes += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            closed = opened.pop()
            height = closed.height + 1
            known[closed.anchor] = (nodes - closed.before, height)
        opened[-1].height = max(opened[-1].height, height)
        if len(opened) + height > MAX_DEPTH + 1:
            raise _too_deep(what)
        if nodes > MAX_NODES:
            raise ContractError(f"{what} has too many parts", f"{MAX_NODES} at most")
