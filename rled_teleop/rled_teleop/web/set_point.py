"""What the page tells the operator, through memory that both processes have: neither ever waits for the other."""

import mmap
import os
import struct
import zlib
from typing import NamedTuple

from rled_msgs_py.errors import RledError

from rled_teleop.web.jog_command import Follow, JogCommand, Move, Turn

OPERATOR = "web_operator"
"""The node that takes the set points."""
RECORD = struct.Struct("<Bddddd??")
"""Kind of the command, its three numbers, until, share, taken, beside."""
CHECK = struct.Struct("<I")
SIZE = RECORD.size + CHECK.size
KINDS = (None, Follow, Move, Turn)


class SetPoint(NamedTuple):
    """All that the operator needs to know of the page.

    Attributes:
        command: what the driver wants; None when nothing is wanted.
        until: when the command ends (s of the machine's monotonic clock, which all processes share).
        share: of full speed, 0 to 1.
        taken: a person has taken over from the agent: where nothing is commanded, the robot holds.
        beside: somebody else answers the states, and the page only takes over.
    """

    command: JogCommand | None = None
    until: float = 0.0
    share: float = 0.5
    taken: bool = False
    beside: bool = True

    def is_commanded(self, now: float) -> bool:
        """Whether something is wanted at a time (s): the deadman."""
        return self.command is not None and now < self.until


class SetPointSlot:
    """Holds one set point, the newest. One process writes, one reads; what was read half written is not taken.

    The memory has no name: it is an open file that the writer's child inherits, and goes when both have ended.

    Args:
        file: descriptor of an existing slot; None makes one.

    Attributes:
        file: its descriptor.

    Raises:
        RledError: the descriptor is not of a slot.
    """

    def __init__(self, file: int | None = None) -> None:
        self.file = os.memfd_create("set_point") if file is None else file
        if file is None:
            os.ftruncate(self.file, SIZE)
        try:
            os.fstat(self.file)  # mmap takes -1 for memory of its own
            self._memory = mmap.mmap(self.file, SIZE)
        except (OSError, ValueError):
            raise RledError(f"open file {file} holds no set points", "one of teleop_web", "start teleop_web") from None
        self._newest = SetPoint()
        if file is None:
            self.put(self._newest)

    def put(self, set_point: SetPoint) -> None:
        """Replace the set point."""
        kind = KINDS.index(None if set_point.command is None else type(set_point.command))
        record = RECORD.pack(kind, *_numbers(set_point.command), *set_point[1:])
        self._memory[:] = record + CHECK.pack(zlib.crc32(record))

    def newest(self) -> SetPoint:
        """The set point; the one before while another is being written."""
        data = self._memory[:]
        record, (check,) = data[: RECORD.size], CHECK.unpack(data[RECORD.size :])
        if check == zlib.crc32(record):
            kind, a, b, c, until, share, taken, beside = RECORD.unpack(record)
            self._newest = SetPoint(_command(kind, a, b, c), until, share, taken, beside)
        return self._newest


def _numbers(command: JogCommand | None) -> tuple[float, float, float]:
    if command is None:
        return (0.0, 0.0, 0.0)
    if isinstance(command, Turn):
        return (float(command.joint), command.goal, 0.0)
    return command.goal if isinstance(command, Follow) else command.direction


def _command(kind: int, *numbers: float) -> JogCommand | None:
    a, b, c = numbers
    if KINDS[kind] is Turn:
        return Turn(int(a), b)
    if KINDS[kind] is None:
        return None
    return Follow((a, b, c)) if KINDS[kind] is Follow else Move((a, b, c))
