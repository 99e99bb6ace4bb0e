"""Bytes and texts with a part changed, whatever they are."""

from random import Random

NUMBERS = (0, 1, 2, 7, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)
WORDS = (
    b"nan",
    b"-inf",
    b".inf",
    b"1e999",
    b"-1",
    b"9" * 40,
    b"0x",
    b"1:1:1:1:1",
    b"null",
    b"true",
    b"~",
    b"!!python/object/apply:os.abort []",
    b"!!binary",
    b"!!int",
    b"!!timestamp 2001-99-99",
    b"2001-99-99",
    b"&a [*a]",
    b"&a [x,x,x,x]",
    b"*a",
    b"<<: *a",
    b"[" * 40,
    b"{a: " * 40,
    b"- " * 40,
    b"../../../etc/passwd",
    b"/dev/stdin",
    b"%s%n{0}{}",
    b"\0",
    b"\xff\xfe",
    b"\xed\xa0\x80",
    b"\xe2\x80\xae",
    b"\n",
    b"\r\n",
    b"\x1b[2J",
    b'"',
    b"'",
    b"x" * 300,
)


def mutate(data: bytes, other: bytes, rng: Random) -> bytes:
    """One change: a bit, a number, a word, a part cut, repeated, moved or taken from another input."""
    change = rng.choice(CHANGES)
    return change(data, other, rng) if data else other or rng.randbytes(8)


def _span(data: bytes, rng: Random) -> tuple[int, int]:
    start = rng.randrange(len(data))
    return start, min(len(data), start + 1 + int(rng.expovariate(1 / 12)))


def _bit(data: bytes, _: bytes, rng: Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _number(data: bytes, _: bytes, rng: Random) -> bytes:
    at, size = rng.randrange(len(data)), rng.choice((1, 2, 4, 8))
    return data[:at] + rng.choice(NUMBERS).to_bytes(9, "little")[:size] + data[at + size :]


def _word(data: bytes, _: bytes, rng: Random) -> bytes:
    start, stop = _span(data, rng)
    return data[:start] + rng.choice(WORDS) + data[rng.choice((start, stop)) :]


def _cut(data: bytes, _: bytes, rng: Random) -> bytes:
    start, stop = _span(data, rng)
    return rng.choice((data[:start], data[:start] + data[stop:]))


def _repeat(data: bytes, _: bytes, rng: Random) -> bytes:
    start, stop = _span(data, rng)
    return data[:start] + data[start:stop] * rng.choice((2, 3, 40, 1000)) + data[stop:]


def _move(data: bytes, _: bytes, rng: Random) -> bytes:
    start, stop = _span(data, rng)
    rest = data[:start] + data[stop:]
    at = rng.randrange(len(rest) + 1)
    return rest[:at] + data[start:stop] + rest[at:]


def _splice(data: bytes, other: bytes, rng: Random) -> bytes:
    start, stop = _span(data, rng)
    if not other:
        return data[:start]
    first, last = _span(other, rng)
    return data[:start] + other[first:last] + data[stop:]


CHANGES = (_bit, _number, _word, _word, _cut, _repeat, _move, _splice)
