"""The path of the end effector, each piece in the colour of who acted."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.records import Actor
from rled_msgs_py.tick import Tick

Colour = tuple[int, int, int]

COLOURS: dict[Actor, Colour] = {
    Actor.AGENT: (37, 99, 235),
    Actor.EXPERT: (234, 136, 12),
    Actor.HUMAN: (22, 163, 74),
    Actor.HOLD: (148, 153, 163),
}
MAX_PIECES = 600
"""Pieces kept."""
MIN_PIECE_LENGTH = 5e-4
"""Motions below this join the piece before them (m)."""


class Pieces(NamedTuple):
    """k straight pieces.

    Attributes:
        points: both ends of each (m), shape (k, 2, 3).
        colours: of both ends, 0 to 255, shape (k, 2, 3).
    """

    points: NDArray[np.float32]
    colours: NDArray[np.uint8]


class Trail:
    """The newest pieces of the path; a new episode begins a new one."""

    def __init__(self) -> None:
        self._ends: deque[tuple[NDArray[np.float64], NDArray[np.float64], Actor]] = deque(maxlen=MAX_PIECES)
        self._last: Tick | None = None

    def add(self, tick: Tick, actor: Actor) -> None:
        """Go on to a tick that somebody's displacement led to."""
        last = self._last
        if last is None or tick.status.episode != last.status.episode or tick.stamp < last.stamp:
            self._ends.clear()
            self._last = tick
        elif float(np.linalg.norm(tick.ee.position - last.ee.position)) >= MIN_PIECE_LENGTH:
            self._ends.append((last.ee.position, tick.ee.position, actor))
            self._last = tick

    def pieces(self) -> Pieces:
        """All of them, oldest first."""
        ends = list(self._ends)
        points = np.array([each[:2] for each in ends], dtype=np.float32).reshape(-1, 2, 3)
        colours = np.array([COLOURS[each[2]] for each in ends], dtype=np.uint8).reshape(-1, 1, 3)
        return Pieces(points, np.repeat(colours, 2, axis=1))
