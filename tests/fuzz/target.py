"""Readers under test: each module of ``targets`` is one, known by its file's name."""

import importlib
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import NamedTuple

from rled_msgs_py.errors import RledError

FOLDER = Path(__file__).parent / "targets"

Mutate = Callable[[bytes, bytes, Random], bytes]


class Target(NamedTuple):
    """A reader.

    Attributes:
        name: of its module.
        read: reads an input, with an empty folder for files that it needs.
        seeds: valid inputs, made by the code that writes them.
        mutate: an input made from one and a part of another.
        refusals: errors by which it may refuse an input.
    """

    name: str
    read: Callable[[bytes, Path], object]
    seeds: Callable[[], Sequence[bytes]]
    mutate: Mutate
    refusals: tuple[type[BaseException], ...]


def names() -> list[str]:
    return sorted(path.stem for path in FOLDER.glob("[a-z]*.py"))


def load(name: str) -> Target:
    module = importlib.import_module(f"{__package__}.targets.{name}")
    refusals = getattr(module, "REFUSALS", (RledError,))
    return Target(name, module.read, module.seeds, module.mutate, refusals)
