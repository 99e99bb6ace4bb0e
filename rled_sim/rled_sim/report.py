"""What the simulation node says of itself on ``/diagnostics``."""

from collections import Counter
from collections.abc import Iterable

from rled_msgs_py.records import Health, Level

from rled_sim.commands import Code, Refused
from rled_sim.driver import Driver
from rled_sim.plant import Contact


class Report:
    """Counts commands, ticks and contacts, and puts them into words once in a while."""

    def __init__(self) -> None:
        self._commands: Counter[Code] = Counter()
        self._code, self._text = Code.ACCEPTED, ""
        self._ticks = self._late = 0
        self._contacts: set[Contact] = set()
        self._last = (0, 0, 0)

    def tick(self, contacts: Iterable[Contact]) -> None:
        """Count a tick, and what the robot touched in it."""
        self._ticks += 1
        self._contacts.update(contacts)

    def late(self, count: int) -> None:
        """Count periods that brought no state within twice their length, in real time."""
        self._late += count

    def accepted(self) -> None:
        """Count a command that was taken; one that a limit then forbids is counted as refused besides."""
        self._commands[Code.ACCEPTED] += 1
        self._code, self._text = Code.ACCEPTED, ""

    def refused(self, error: Refused) -> None:
        """Count a command that was not taken, or not carried out."""
        self._commands[error.code] += 1
        self._code, self._text = error.code, str(error)

    def health(self, now: int, driver: Driver, simulations: int) -> Health:
        """The report since the last one.

        Args:
            now: wall time (ns).
            driver: what is reported on.
            simulations: publishers of joint_states in the graph, this one among them.
        """
        refusals = sum(self._commands.values()) - self._commands[Code.ACCEPTED]
        then, ticks, known = self._last
        self._last = now, self._ticks, refusals
        contacts, self._contacts = sorted(self._contacts), set()
        level, message = self._summary(driver, simulations, refusals - known, bool(contacts))
        values = {
            "code": str(self._code.value),
            "text": self._text,
            "ticks": str(self._ticks),
            "ticks_per_second": f"{(self._ticks - ticks) * 1e9 / (now - then) if now > then else 0.0:.1f}",
            "deadlines_missed": str(self._late),
            "stamp": str(driver.stamp),
            "episode": str(driver.number),
            "contacts": ", ".join(f"{link} with {other}" for link, other in contacts),
        }
        counts = {f"commands_{code.name.lower()}": str(self._commands[code]) for code in Code}
        return Health(now, level, "sim: driver", message, values | counts)

    def _summary(self, driver: Driver, simulations: int, refused: int, touching: bool) -> tuple[Level, str]:
        if simulations > 1:
            return Level.ERROR, f"{simulations} simulations in this graph"
        if driver.stopped:
            return Level.ERROR, "emergency stop"
        if refused:
            return Level.WARN, f"{refused} commands refused" + (f", the last: {self._text}" if self._text else "")
        if touching:
            return Level.WARN, "the robot touches something"
        return Level.OK, "paused" if driver.paused else driver.rules.mode
