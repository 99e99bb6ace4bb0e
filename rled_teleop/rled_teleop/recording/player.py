"""Playing a recording back: which of its messages are due, at a rate, in a loop, with pauses."""

import numpy as np
from numpy.typing import NDArray


class Player:
    """Knows which messages are due. Time runs when it is asked, so it needs no thread.

    Args:
        times: of the messages (ns), ascending, shape (k,).
        rate: recorded seconds a second of now.
        loop: begin again after the end.
        now: time of the beginning (s).

    Attributes:
        paused: time stands still.
    """

    def __init__(self, times: NDArray[np.int64], rate: float, loop: bool, now: float) -> None:
        self._times, self._rate, self._loop = times, rate, loop
        self._position, self._seen = float(times[0]) if len(times) else 0.0, now
        self._next = 0
        self.paused = False

    @property
    def finished(self) -> bool:
        """All messages were due, and it does not begin again."""
        return not self._loop and self._next == len(self._times)

    def due(self, now: float) -> range:
        """Places of the messages that came due since the last call, at a time (s).

        In a loop, the last message is followed by the first in the next call.
        """
        if not self.paused:
            self._position += (now - self._seen) * 1e9 * self._rate
        self._seen = now
        if self._loop and self._next == len(self._times):
            self._next, self._position = 0, float(self._times[0]) if len(self._times) else 0.0
        first, self._next = self._next, int(np.searchsorted(self._times, self._position, side="right"))
        return range(first, self._next)

    def pause(self, on: bool, now: float) -> range:
        """Stand still or go on from a time (s); returns what came due until then."""
        places = self.due(now)
        self.paused = on
        return places
