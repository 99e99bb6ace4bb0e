"""The tables of faults: rows as the tests measure them, and docs/faults.md made of them.

``make faults`` measures all rows of the first table anew and writes them. In every other run a row must say what the
document says, but for its milliseconds. The second table is written by hand; each of its rows names its test.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCUMENT = ROOT / "docs" / "faults.md"
MEASURED = ROOT / "out" / "faults"
WRITES = os.environ.get("RLED_FAULTS") == "write"
BY_HAND = "\n## Files, commands, pages and other people's robots\n"
"""Where the second table begins."""

HEAD = """# Faults, and what becomes of them

Made by `make faults` from what the tests in `tests/faults` measured, with real processes over DDS on one machine. The
time runs from the fault to what somebody else in the graph sees of the decision: a tick, a report, an answer, silence.
*Within limits* says that from then on no joint left its limits and none moved by more than Δq_max in a period.

| fault | who decides | decision | ms | within limits |
|---|---|---|---|---|
"""


class Row(NamedTuple):
    """One line.

    Attributes:
        fault: what was done.
        who: the part that decided.
        decision: what it decided.
        milliseconds: until it was seen.
        within_limits: joints and displacements stayed within their limits.
    """

    fault: str
    who: str
    decision: str
    milliseconds: float
    within_limits: bool

    def text(self) -> str:
        """The line without its time."""
        return f"| {self.fault} | {self.who} | {self.decision} |"

    def line(self) -> str:
        """All of it."""
        time = f"{self.milliseconds:.1f}" if self.milliseconds < 10.0 else f"{self.milliseconds:.0f}"
        return f"{self.text()} {time} | {'yes' if self.within_limits else 'no'} |\n"


def keep(name: str, rows: list[Row]) -> None:
    """Keep the rows of one test file."""
    MEASURED.mkdir(parents=True, exist_ok=True)
    (MEASURED / f"{name}.json").write_text(json.dumps(rows))


def main() -> None:
    """Write the document."""
    files = sorted(MEASURED.glob("*.json"))
    rows = [Row(*values) for file in files for values in json.loads(file.read_text())]
    _, heading, by_hand = DOCUMENT.read_text().partition(BY_HAND)
    DOCUMENT.write_text(HEAD + "".join(row.line() for row in rows) + heading + by_hand)
    print(f"{len(rows)} faults in {DOCUMENT.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
