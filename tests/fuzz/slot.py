"""What a worker is doing, in memory that its watcher sees too: whatever ends the worker, its last input is known."""

import mmap
from pathlib import Path
from struct import Struct
from typing import NamedTuple

from .bounds import INPUT

HEAD = Struct("<QQI")
"""Inputs begun, inputs ended, bytes of the newest."""


class State(NamedTuple):
    """Inputs begun and ended; between the two numbers the worker reads one."""

    begun: int
    ended: int

    @property
    def is_busy(self) -> bool:
        return self.begun != self.ended


class Slot:
    """The memory, a file of both processes."""

    def __init__(self, path: Path) -> None:
        with path.open("a+b") as file:
            file.truncate(HEAD.size + INPUT)
            self._memory = mmap.mmap(file.fileno(), HEAD.size + INPUT)

    def begin(self, data: bytes) -> None:
        state = self.state()
        self._memory[HEAD.size : HEAD.size + len(data)] = data
        HEAD.pack_into(self._memory, 0, state.begun + 1, state.ended, len(data))

    def end(self) -> None:
        begun, _, length = HEAD.unpack_from(self._memory)
        HEAD.pack_into(self._memory, 0, begun, begun, length)

    def state(self) -> State:
        return State(*HEAD.unpack_from(self._memory)[:2])

    def newest(self) -> bytes:
        return self._memory[HEAD.size : HEAD.size + HEAD.unpack_from(self._memory)[2]]
