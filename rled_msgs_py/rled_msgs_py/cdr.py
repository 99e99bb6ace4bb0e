"""Plain CDR, the encoding of messages on the wire and in bags (DDS-XTYPES 1.3, 7.4.1), as far as our types need it."""

import struct
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rled_msgs_py.errors import Unreadable

ENCAPSULATION = 4
"""Bytes that tell the encoding; alignment counts from their end."""
FORMATS = {order: (struct.Struct(f"{order}I"), struct.Struct(f"{order}iI"), np.dtype(f"{order}f8")) for order in "<>"}
"""Count, time and doubles, by byte order."""

COUNT, TIME, DOUBLE = FORMATS["<"]
GAPS = tuple(bytes(3 - length) for length in range(4))
"""Zeros behind a string of so many bytes, less whole fours, and its own zero."""

KNOWN = 4096
"""Maximum bytes of a sequence of strings that is remembered; the names of a hundred joints fit."""

_known: tuple[int, bytes, tuple[str, ...]] = -1, b"", ()
"""Place, bytes and members of the sequence of strings read last."""


class CdrReader:
    """Takes fields off a serialized message, one after the other.

    Args:
        data: the message.

    Raises:
        Unreadable: another encoding; from every method: the message ends before the field does.
    """

    def __init__(self, data: bytes) -> None:
        if data[:2] not in (b"\x00\x00", b"\x00\x01"):
            raise Unreadable(f"a message in the encoding '{data[:2].hex()}'", "plain CDR (0000 or 0001)")
        self._data, self._at = data, ENCAPSULATION
        self._count, self._time, self._double = FORMATS["<" if data[1] else ">"]

    def _place(self, size: int, alignment: int) -> int:
        start = self._at + (ENCAPSULATION - self._at) % alignment
        self._at = start + size
        if self._at > len(self._data):
            raise self._broken()
        return start

    def _broken(self) -> Unreadable:
        return Unreadable(f"a message of {len(self._data)} bytes that breaks off")

    def time(self) -> tuple[int, int]:
        """Seconds and nanoseconds of a builtin_interfaces/Time."""
        seconds, nanoseconds = self._time.unpack_from(self._data, self._place(8, 4))
        return seconds, nanoseconds

    def octet(self) -> int:
        """One byte."""
        return self._data[self._place(1, 1)]

    def count(self) -> int:
        """Length of a sequence."""
        number: int = self._count.unpack_from(self._data, self._place(4, 4))[0]
        return number

    def text(self) -> str:
        """A string."""
        return self.strings(1)[0]

    def strings(self, count: int) -> list[str]:
        """So many strings, one behind the other."""
        data, at, unpack = self._data, self._at, self._count.unpack_from
        found = []
        try:
            for _ in range(count):
                start = (at + 7) & -4  # past the length, which is aligned
                at = start + unpack(data, start - 4)[0]
                found.append(data[start : at - 1].decode())
        except struct.error:
            raise self._broken() from None
        except UnicodeDecodeError as error:
            raise Unreadable(f"a text that is not UTF-8 ({error.reason})") from None
        self._at = at
        if at > len(data):
            raise self._broken()
        return found

    def texts(self) -> tuple[str, ...]:
        """A sequence of strings; the same one again, as joint names are, is known by its bytes."""
        global _known
        begun, (place, block, texts) = self._at, _known
        if begun == place and self._data.startswith(block, begun):
            self._at += len(block)
            return texts
        texts = tuple(self.strings(self.members()))
        if self._at - begun <= KNOWN:
            _known = begun, self._data[begun : self._at], texts
        return texts

    def members(self) -> int:
        """Length of a sequence whose members take a byte at least."""
        if (count := self.count()) > len(self._data):
            raise Unreadable(f"a message of {len(self._data)} bytes with {count} members in a sequence")
        return count

    def doubles(self, count: int) -> NDArray[np.float64]:
        """So many float64, shape (count,); they share memory with the message."""
        if not count:
            return np.empty(0)
        start = self._place(8 * count, 8)
        return np.frombuffer(self._data, self._double, count, start)


class CdrWriter:
    """Puts a message together, little endian; what lies between fields is zero."""

    def __init__(self) -> None:
        self._data = bytearray(b"\x00\x01\x00\x00")

    def _align(self, alignment: int) -> None:
        self._data += bytes((ENCAPSULATION - len(self._data)) % alignment)

    def time(self, seconds: int, nanoseconds: int) -> None:
        """A builtin_interfaces/Time."""
        self._align(4)
        self._data += TIME.pack(seconds, nanoseconds)

    def octet(self, value: int) -> None:
        """One byte."""
        self._data.append(value)

    def count(self, number: int) -> None:
        """Length of a sequence."""
        self._align(4)
        self._data += COUNT.pack(number)

    def text(self, text: str) -> None:
        """A string."""
        self.strings((text,))

    def strings(self, texts: Iterable[str]) -> None:
        """Strings, one behind the other."""
        self._align(4)
        parts: list[bytes] = []
        gap = b""
        for text in texts:
            encoded = text.encode()
            parts += gap, COUNT.pack(len(encoded) + 1), encoded, b"\0"
            gap = GAPS[len(encoded) % 4]
        self._data += b"".join(parts)

    def doubles(self, values: NDArray[np.float64]) -> None:
        """Float64 values without their count, shape (k,)."""
        if len(values):
            self._align(8)
            self._data += values.astype(DOUBLE).tobytes()

    def bytes(self) -> bytes:
        """The message."""
        return bytes(self._data)
