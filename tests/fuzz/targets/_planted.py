"""A reader with every fault that the watcher has to find, chosen by the input; for the watcher's own test."""

import ctypes
import os
import select
from pathlib import Path

from rled_msgs_py.errors import RledError

from ..mutators.plain import mutate as mutate

LEFT = []


def seeds() -> list[bytes]:
    return [b"fine"]


def read(data: bytes, folder: Path) -> None:
    if data in FAULTS:
        FAULTS[data]()
    elif data == b"fine":
        (folder / "file").write_bytes(data)
    elif data == b"refused":
        raise RledError("an input that is refused")
    deep(data)


def deep(data: bytes) -> None:
    """What is found by its lines only: random bytes hit it once in ten million."""
    if data[:1] == b"R":  # noqa: SIM102
        if data[1:2] == b"L":  # noqa: SIM102
            if data[2:3] == b"D":
                raise ValueError("deep")


def raises() -> None:
    raise KeyError("planted")


def works() -> None:
    while True:
        pass


def waits() -> None:
    select.select([], [], [], None)


def eats() -> None:
    bytearray(600 << 20)[:: 1 << 12] = bytes(600 << 8)


def asks() -> None:
    bytes(1 << 40)


def leaves() -> None:
    LEFT.append(bytearray(600 << 20))
    LEFT[-1][:: 1 << 12] = bytes(600 << 8)


def breaks() -> None:
    ctypes.string_at(0)


def leaves_process() -> None:
    os._exit(3)


def exits() -> None:
    raise SystemExit(0)


def sinks() -> None:
    sinks()


FAULTS = {
    each.__name__.encode(): each
    for each in (raises, works, waits, eats, asks, leaves, breaks, leaves_process, exits, sinks)
}
