"""What visitors can make the robot do: the only way from the page to the robot."""

import time
from collections.abc import Callable
from threading import Lock, RLock
from typing import Any

from rled_teleop.web.jog_command import JogCommand
from rled_teleop.web.set_point import SetPoint
from rled_teleop.web.visitors import Visitors

DRIVER_TIMEOUT = 5.0
"""So long a driver may be silent before another visitor may take over (s)."""


class Requests:
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
    """Permissions, commands and requests. Its methods are called by the page's threads and by the node's.

    Args:
        timeout: deadman: a command that the page does not renew ends so long (s) after.
        give: takes each new set point, for the operator.
        clock: seconds.

    Attributes:
        visitors: who is there and who drives.
        asked: requests to other nodes.
    """

    def __init__(
        self, timeout: float, give: Callable[[SetPoint], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._timeout, self._give, self._clock = timeout, give, clock
        self.visitors = Visitors(DRIVER_TIMEOUT)
        self.requests = Requests()
        self._lock = RLock()
        self._set_point = SetPoint()
        self._commander: int | None = None

    @property
    def share(self) -> float:
        """Of full speed, 0 to 1."""
        return self._set_point.share

    @property
    def taken(self) -> bool:
        """A person has taken over from the agent: where nothing is commanded, the robot holds."""
        return self._set_point.taken

    @property
    def beside(self) -> bool:
        """Somebody else answers the states; the page only takes over."""
        return self._set_point.beside

    def arrive(self, visitor: int) -> None:
        """A visitor has opened the page."""
        self.visitors.arrive(visitor, self._clock())

    def leave(self, visitor: int) -> None:
        """A visitor is gone, and its command with it."""
        self.release(visitor)
        self.visitors.leave(visitor)

    def take(self, visitor: int) -> bool:
        """A visitor wants to drive; what another one commanded ends when it does."""
        with self._lock:
            before = self.visitors.driver
            if self.visitors.take(visitor, self._clock()) and before != visitor:
                self._drop()
            return self.drives(visitor)

    def may_take(self, visitor: int) -> bool:
        """Whether this visitor drives when it asks for it."""
        return self.drives(visitor) or self.visitors.may_take(self._clock())

    def let_go(self, visitor: int) -> None:
        """The driver does not want to drive any more."""
        self.release(visitor)
        self.visitors.let_go(visitor)

    def drives(self, visitor: int | None) -> bool:
        """Whether this visitor may move the robot."""
        return visitor is not None and self.visitors.driver == visitor

    def command(self, visitor: int | None, command: JogCommand, lasts: float | None = None) -> None:
        """The driver commands something, for ``lasts`` seconds; what others command is nothing."""
        with self._lock:
            if visitor is not None and self.drives(visitor):
                now = self._clock()
                self.visitors.hear(visitor, now)
                self._commander = visitor
                self._change(command=command, until=now + (self._timeout if lasts is None else lasts))

    def hear(self, visitor: int, holds: bool) -> None:
        """A sign of life of the page; while the pointer holds something, the command goes on, unless it has ended."""
        with self._lock:
            now = self._clock()
            self.visitors.hear(visitor, now)
            if holds and visitor == self._commander and self._set_point.is_commanded(now):
                self._change(until=max(now + self._timeout, self._set_point.until))

    def release(self, visitor: int | None) -> None:
        """The pointer was released."""
        with self._lock:
            if visitor is not None and visitor == self._commander:
                self._drop()

    def set_share(self, visitor: int | None, share: float) -> None:
        """The driver sets the share of full speed, 0 to 1."""
        if self.drives(visitor):
            self._change(share=share)

    def switch_taken(self, visitor: int | None) -> None:
        """The driver takes over from the agent, or hands back."""
        if self.drives(visitor):
            self._change(taken=not self.taken)

    def stand(self, beside: bool) -> None:
        """Answer the states from now on, or only take over from somebody who does."""
        self._change(beside=beside)

    def ask(self, visitor: int | None, what: str, value: Any = None) -> None:
        """The driver asks another node for something."""
        if self.drives(visitor):
            self.requests.put(what, value)

    def stop(self) -> None:
        """Emergency stop, for every visitor."""
        self._drop()
        self.requests.put("estop")

    def is_commanded(self) -> bool:
        """Whether somebody moves the robot now, or keeps it from an agent."""
        return self.taken or self._set_point.is_commanded(self._clock())

    def _drop(self) -> None:
        self._commander = None
        self._change(command=None)

    def _change(self, **parts: Any) -> None:
        with self._lock:
            self._set_point = self._set_point._replace(**parts)
            self._give(self._set_point)
