"""What visitors can make the robot do: the only way from the page to the robot."""

import time
from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rled_teleop.jog import Jog
from rled_teleop.web.visitors import Visitors
from rled_teleop.web.wish import Wish, WishBox, delta

Vector = NDArray[np.float64]

PATIENCE = 5.0
"""So long a driver may be silent before another visitor may take over (s)."""


class Asked:
    """What the page asks the graph for, the newest of each kind; a flood of clicks is one request."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._asked: dict[str, Any] = {}

    def put(self, what: str, value: Any = None) -> None:
        """Ask for something."""
        with self._lock:
            self._asked[what] = value

    def take(self) -> dict[str, Any]:
        """All that was asked since the last time, in order."""
        with self._lock:
            asked, self._asked = self._asked, {}
        return asked


class Control:
    """Permissions, wishes and requests. Its methods are called by the page's thread and by the node's.

    Args:
        timeout: deadman: a wish that the page does not renew ends so long (s) after.
        clock: seconds.

    Attributes:
        visitors: who is there and who drives.
        asked: requests to other nodes.
        share: of full speed.
        taken: a person has taken over from the agent: where nothing is wished, the robot holds.
    """

    def __init__(self, timeout: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._timeout, self._clock = timeout, clock
        self.visitors = Visitors(PATIENCE)
        self.asked = Asked()
        self._wishes = WishBox()
        self.share, self.taken = 0.5, False

    def arrive(self, visitor: int) -> None:
        """A visitor has opened the page."""
        self.visitors.arrive(visitor, self._clock())

    def leave(self, visitor: int) -> None:
        """A visitor is gone, and its wish with it."""
        self._wishes.drop(visitor)
        self.visitors.leave(visitor)

    def take(self, visitor: int) -> bool:
        """A visitor wants to drive; what another one wished ends when it does."""
        before = self.visitors.driver
        if self.visitors.take(visitor, self._clock()) and before != visitor:
            self._wishes.drop()
        return self.drives(visitor)

    def may_take(self, visitor: int) -> bool:
        """Whether this visitor drives when it asks for it."""
        return self.drives(visitor) or self.visitors.may_take(self._clock())

    def let_go(self, visitor: int) -> None:
        """The driver does not want to drive any more."""
        self._wishes.drop(visitor)
        self.visitors.let_go(visitor)

    def drives(self, visitor: int | None) -> bool:
        """Whether this visitor may move the robot."""
        return visitor is not None and self.visitors.driver == visitor

    def wish(self, visitor: int | None, wish: Wish, lasts: float | None = None) -> None:
        """The driver wishes something, for ``lasts`` seconds; what others wish is nothing."""
        if visitor is not None and self.drives(visitor):
            now = self._clock()
            self.visitors.hear(visitor, now)
            self._wishes.put(visitor, wish, now + (self._timeout if lasts is None else lasts))

    def hear(self, visitor: int, holds: bool) -> None:
        """A sign of life of the page; while the pointer holds something, the wish goes on."""
        now = self._clock()
        self.visitors.hear(visitor, now)
        if holds:
            self._wishes.renew(visitor, now + self._timeout)

    def release(self, visitor: int | None) -> None:
        """The pointer was released."""
        if visitor is not None:
            self._wishes.drop(visitor)

    def ask(self, visitor: int | None, what: str, value: Any = None) -> None:
        """The driver asks another node for something."""
        if self.drives(visitor):
            self.asked.put(what, value)

    def stop(self) -> None:
        """Emergency stop, for every visitor."""
        self._wishes.drop()
        self.asked.put("estop")

    def is_wished(self) -> bool:
        """Whether somebody moves the robot now, or keeps it from an agent."""
        return self.taken or self._wishes.newest(self._clock()) is not None

    def steer(self, jog: Jog, q: Vector) -> Vector | None:
        """Δq (rad) of one tick for joint angles (rad), shape (n,); None when nobody wishes anything."""
        wish = self._wishes.newest(self._clock())
        if wish is None:
            return np.zeros(len(q)) if self.taken else None
        return delta(wish, jog, q, self.share)
