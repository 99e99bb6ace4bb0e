"""Who may drive: the first visitor does, all others watch until the first lets go, leaves or falls silent."""

from threading import Lock


class Visitors:
    """The visitors of the page, of whom one at most drives. All methods are thread-safe.

    Args:
        timeout: so long (s) a driver may be silent before somebody else may take over.
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._lock = Lock()
        self._present: list[int] = []
        self._driver: int | None = None
        self._heard = 0.0

    @property
    def driver(self) -> int | None:
        """Who drives; None when nobody does."""
        return self._driver

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self._present)

    def arrive(self, visitor: int, now: float) -> None:
        """A visitor comes, and drives if nobody does."""
        with self._lock:
            self._present.append(visitor)
            if self._driver is None:
                self._driver, self._heard = visitor, now

    def leave(self, visitor: int) -> None:
        """A visitor goes; nobody is made the driver in its place without asking for it."""
        with self._lock:
            if visitor in self._present:
                self._present.remove(visitor)
            if self._driver == visitor:
                self._driver = None

    def let_go(self, visitor: int) -> None:
        """The driver only watches from now on."""
        with self._lock:
            if self._driver == visitor:
                self._driver = None

    def take(self, visitor: int, now: float) -> bool:
        """A visitor wants to drive; return whether it does now."""
        with self._lock:
            if visitor in self._present and self._may_take(now):
                self._driver, self._heard = visitor, now
            return self._driver == visitor

    def may_take(self, now: float) -> bool:
        """Whether whoever asks at a time (s) becomes the driver."""
        with self._lock:
            return self._may_take(now)

    def hear(self, visitor: int, now: float) -> None:
        """A sign of life at a time (s)."""
        with self._lock:
            if visitor == self._driver:
                self._heard = max(now, self._heard)

    def _may_take(self, now: float) -> bool:
        return self._driver is None or now - self._heard > self._timeout
