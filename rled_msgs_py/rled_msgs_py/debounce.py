"""What is said to people only when it has lasted. Times are seconds of any clock that does not go back."""

from collections.abc import Callable

FIRST_REPORT_AFTER = 2.0
REPORT_PERIOD = 10.0
"""Seconds of waiting after which it is said what for, and after which it is said again."""


class Debounce:
    """A condition that comes and goes; only a change that holds is told. The first True is no change, and told at once.

    Args:
        hold: how long a change has to last (s).
        changed: told of the condition.
    """

    def __init__(self, hold: float, changed: Callable[[bool], object]) -> None:
        self._hold, self._changed = hold, changed
        self._told: bool | None = None
        self._newest, self._since = False, 0.0

    def see(self, condition: bool, now: float) -> None:
        """Take the condition at a time."""
        if condition != self._newest:
            self._newest, self._since = condition, now
        if condition and self._told is None:
            self._tell()

    def poll(self, now: float) -> None:
        """Tell of a change that has lasted until now; call it now and then."""
        if self._told is not None and self._newest != self._told and now - self._since >= self._hold:
            self._tell()

    def _tell(self) -> None:
        self._told = self._newest
        self._changed(self._newest)


class WaitingReport:
    """When to say what is waited for: after a moment, and again now and then."""

    def __init__(self) -> None:
        self._awaited, self._said = "", 0.0

    def is_due(self, awaited: str, now: float) -> bool:
        """Whether to say now what is waited for; empty when nothing is."""
        if awaited != self._awaited:
            self._awaited, self._said = awaited, now + FIRST_REPORT_AFTER - REPORT_PERIOD
        if not awaited or now - self._said < REPORT_PERIOD:
            return False
        self._said = now
        return True
