"""Progress of long work: a bar on a terminal, plain lines elsewhere."""

import math
import sys
import time
from collections.abc import Mapping
from types import TracebackType

from tqdm import tqdm

INTERVAL = 1.0
"""Least time between two looks of the bar, or two plain lines (s)."""


class Progress:
    """Shows how much is done; a context manager, which leaves the bar as it is.

    Args:
        unit: what is counted ("step").
        total: how many there will be.
        done: how many there are already.
    """

    def __init__(self, unit: str, total: int, done: int = 0) -> None:
        self._unit, self._total, self._said = unit, total, -math.inf
        self._plain = not sys.stderr.isatty()
        self._bar = tqdm(
            total=total, initial=done, unit=unit, mininterval=INTERVAL, dynamic_ncols=True, disable=self._plain
        )

    def move(self, done: int) -> None:
        """So many are done."""
        self._bar.update(done - self._bar.n)

    def say(self, done: int, metrics: Mapping[str, float]) -> None:
        """So many are done, and this is how it goes; a metric that is no number is left out."""
        shown = {name: f"{value:.3g}" for name, value in metrics.items() if math.isfinite(value)}
        self.move(done)
        if not self._plain:
            self._bar.set_postfix(shown, refresh=False)
        elif done >= self._total or time.monotonic() - self._said > INTERVAL:
            said = ", ".join(f"{name} {value}" for name, value in shown.items())
            print(f"{self._unit} {done:,} of {self._total:,}: {said}", file=sys.stderr, flush=True)
            self._said = time.monotonic()

    def close(self) -> None:
        """Leave the bar as it is."""
        self._bar.close()

    def __enter__(self) -> "Progress":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
