"""Where the fields of a serialized message lie, so that many messages of one layout are read as one array."""

from struct import unpack_from
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rled_msgs_py.bags.storage import Messages
from rled_msgs_py.cdr import ENCAPSULATION
from rled_msgs_py.messages import NANOSECONDS

PLAIN_CDR_LITTLE_ENDIAN = (0, 1)
VARYING = frozenset({"sec", "nanosec", "position", "orientation", "velocity", "effort"})
"""Fields that differ from message to message; all others are the same in messages of one layout."""


class Layout:
    """Places of the fields of one message, added in the order of its definition (plain CDR, little endian).

    Args:
        message: the message that the lengths of its texts and sequences are read from.
    """

    def __init__(self, message: bytes) -> None:
        self._message = message
        self._end = ENCAPSULATION
        self._places: dict[str, tuple[DTypeLike, int]] = {"encoding": (("u1", (2,)), 0)}

    def add(self, name: str, kind: DTypeLike, alignment: int) -> int:
        """Place a field; returns where. CDR aligns to the end of the encapsulation header."""
        start = self._end + (ENCAPSULATION - self._end) % alignment
        self._places[name] = (kind, start)
        self._end = start + np.dtype(kind).itemsize
        if self._end > len(self._message):
            raise ValueError(f"{name} ends after the message")
        return start

    def count(self, name: str) -> int:
        """Place the length of a sequence; returns this message's."""
        start = self.add(f"{name} count", "<u4", 4)
        return int(unpack_from("<I", self._message, start)[0])

    def text(self, name: str) -> None:
        """Place a string."""
        self.add(name, ("u1", (self.count(name),)), 1)

    def doubles(self, name: str, count: int) -> None:
        """Place float64 values, none of them when ``count`` is 0."""
        if count:
            self.add(name, ("<f8", (count,)), 8)

    def header(self) -> None:
        """Place a std_msgs/Header."""
        self.add("sec", "<i4", 4)
        self.add("nanosec", "<u4", 4)
        self.text("frame")

    def dtype(self) -> np.dtype[np.void]:
        """The message as an array element."""
        kinds, starts = zip(*self._places.values(), strict=True)
        return np.dtype({"names": [*self._places], "formats": kinds, "offsets": starts, "itemsize": len(self._message)})


def view(run: Messages, dtype: np.dtype[np.void]) -> NDArray[np.void] | None:
    """The messages of a run through one layout, shape (k,), or None when they do not all have it.

    Args:
        run: messages.
        dtype: the layout of the first.
    """
    if (run.size != dtype.itemsize).any():
        return None
    # a view of the buffer with a message beginning at every byte
    places = len(run.data) - dtype.itemsize + 1
    everywhere: NDArray[Any] = np.ndarray(places, f"V{dtype.itemsize}", run.data, strides=(1,))
    rows = everywhere[run.start].view(dtype)
    fixed = (rows[name] for name in dtype.names or () if name not in VARYING)
    same = all((field == field[0]).all() for field in fixed)
    return rows if same and tuple(rows["encoding"][0]) == PLAIN_CDR_LITTLE_ENDIAN else None


def stamps_of(rows: NDArray[np.void]) -> NDArray[np.int64] | None:
    """Stamps (ns), shape (k,), or None when one is not valid."""
    if (rows["sec"] < 0).any() or (rows["nanosec"] >= NANOSECONDS).any():
        return None
    stamps: NDArray[np.int64] = rows["sec"].astype(np.int64) * NANOSECONDS + rows["nanosec"]
    return stamps
