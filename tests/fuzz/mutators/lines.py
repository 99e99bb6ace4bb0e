"""Texts of lines (CSV, HTTP heads, command lines): a line gone, doubled, moved, or with a part of it changed."""

from random import Random

from . import plain

WORDS = (
    b"nan",
    b"-1",
    b"1e999",
    b"true",
    b"--",
    b"-h",
    b"--ros-args",
    b"-p",
    b"x:=1",
    b"[",
    b"[::1",
    b"http://[",
    b"//",
    b"%zz",
)


def mutate(data: bytes, other: bytes, rng: Random) -> bytes:
    lines, donors = data.split(b"\n"), other.split(b"\n")
    at, kind = rng.randrange(len(lines)), rng.randrange(7)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines[at:at] = lines[at : at + 1] * rng.choice((1, 2, 200))
    elif kind == 2:
        lines.insert(rng.randrange(len(lines)), lines.pop(at))
    elif kind == 3:
        lines.insert(at, rng.choice(donors))
    elif kind == 4:
        lines[at] = rng.choice(WORDS)
    elif kind == 5:
        key, mark, rest = lines[at].partition(rng.choice((b":", b",", b"=")))
        lines[at] = key + mark + rng.choice((rng.choice(WORDS), plain.mutate(rest, rest, rng)))
    else:
        lines[at] = plain.mutate(lines[at], rng.choice(donors), rng)
    return b"\n".join(lines)
