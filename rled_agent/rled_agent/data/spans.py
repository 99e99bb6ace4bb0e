"""Stretches of a recording, each its first moment and its end (ns)."""

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.bags.episodes import FOREVER


def outside(spans: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """What lies outside of spans with their last moments in them: first moment and end of each part (ns)."""
    ends = [0, *(last + 1 for _, last in spans)]
    return [(end, first) for end, first in zip(ends, [*(first for first, _ in spans), FOREVER], strict=True)]


def lie_in(stamps: NDArray[np.int64], spans: list[tuple[int, int]]) -> NDArray[np.bool_]:
    """Whether each stamp lies in one of spans, each its first moment and its end, shape (k,)."""
    inside = np.zeros(len(stamps), dtype=bool)
    for first, stop in spans:
        inside |= (stamps >= first) & (stamps < stop)
    return inside
