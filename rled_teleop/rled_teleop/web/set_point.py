"""What the page tells the operator, through memory that both processes have: neither ever waits for the other."""

import mmap
import os
import struct
import zlib
from typing import NamedTuple

from rled_msgs_py.errors import RledError

from rled_teleop.web.jog_command import Follow, Move, Turn, Wish

OPERATOR = "web_operator"
"""The node that takes the orders."""
RECORD = struct.Struct("<Bddddd??")
"""Kind of the wish, its three numbers, until, share, taken, beside."""
CHECK = struct.Struct("<I")
SIZE = RECORD.size + CHECK.size
KINDS = (None, Follow, Move, Turn)


class Order(NamedTuple):
    """All that the operator needs to know of the page.

    Attributes:
        wish: what the driver wants; None when nothing is wanted.
        until: when the wish ends (s of the machine's monotonic clock, which all processes share).
        share: of full speed, 0 to 1.
        taken: a person has taken over from the agent: where nothing is wished, the robot holds.
        beside: somebody else answers the states, and the page only takes over.
    """

    wish: Wish | None = None
    until: float = 0.0
    share: float = 0.5
    taken: bool = False
    beside: bool = True

    def is_wished(self, now: float) -> bool:
        """Whether something is wanted at a time (s): the deadman."""
        return self.wish is not None and now < self.until


class OrderSlot:
    """Holds one order, the newest. One process writes, one reads; what was read half written is not taken.

    The memory has no name: it is an open file that the writer's child inherits, and goes when both have ended.

    Args:
        file: descriptor of an existing slot; None makes one.

    Attributes:
        file: its descriptor.

    Raises:
        RledError: the descriptor is not of a slot.
    """

    def __init__(self, file: int | None = None) -> None:
        self.file = os.memfd_create("order") if file is None else file
        if file is None:
            os.ftruncate(self.file, SIZE)
        try:
            os.fstat(self.file)  # mmap takes -1 for memory of its own
            self._memory = mmap.mmap(self.file, SIZE)
        except (OSError, ValueError):
            raise RledError(f"open file {file} holds no orders", "one of teleop_web", "start teleop_web") from None
        self._newest = Order()
        if file is None:
            self.put(self._newest)

    def put(self, order: Order) -> None:
        """Replace the order."""
        kind = KINDS.index(None if order.wish is None else type(order.wish))
        record = RECORD.pack(kind, *_numbers(order.wish), *order[1:])
        self._memory[:] = record + CHECK.pack(zlib.crc32(record))

    def newest(self) -> Order:
        """The order; the one before while another is being written."""
        data = self._memory[:]
        record, (check,) = data[: RECORD.size], CHECK.unpack(data[RECORD.size :])
        if check == zlib.crc32(record):
            kind, a, b, c, until, share, taken, beside = RECORD.unpack(record)
            self._newest = Order(_wish(kind, a, b, c), until, share, taken, beside)
        return self._newest


def _numbers(wish: Wish | None) -> tuple[float, float, float]:
    if wish is None:
        return (0.0, 0.0, 0.0)
    if isinstance(wish, Turn):
        return (float(wish.joint), wish.goal, 0.0)
    return wish.goal if isinstance(wish, Follow) else wish.direction


def _wish(kind: int, *numbers: float) -> Wish | None:
    a, b, c = numbers
    if KINDS[kind] is Turn:
        return Turn(int(a), b)
    if KINDS[kind] is None:
        return None
    return Follow((a, b, c)) if KINDS[kind] is Follow else Move((a, b, c))
