"""Progress of long work: a bar on a terminal, plain lines elsewhere."""

import math
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from types import TracebackType

from tqdm import tqdm

SHOWN = {
    "updates_per_second": "updates/s",
    "reward": "return",
    "targets_reached": "targets",
    "demonstrated_share": "demonstrated",
    "qcd_median": "uncertainty",
}
"""Metrics beside the bar, where there are any."""
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

    def say(self, done: int, metrics: Mapping[str, float | str]) -> None:
        """So many are done, and this is how it goes; a metric that is no number is left out."""
        shown = {name: _said(value) for name, value in metrics.items() if _is_told(value)}
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


def _said(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.3g}"


def _is_told(value: float | str) -> bool:
    return isinstance(value, str) or math.isfinite(value)


def summary(rows: Sequence[Mapping[str, float]], names: Sequence[str]) -> dict[str, float | str]:
    """How the runs of a population are doing: mean ± standard deviation, and the run that lags behind.

    Args:
        rows: of metrics, one for each run that goes on.
        names: of these runs.
    """
    if len(rows) < 2:
        return {shown: row[name] for row in rows for name, shown in SHOWN.items() if name in row}
    known = [name for name in SHOWN if all(math.isfinite(row.get(name, math.nan)) for row in rows)]
    told: dict[str, float | str] = {SHOWN[name]: _spread([row[name] for row in rows]) for name in known}
    told |= {"updates/s": f"{sum(row['updates_per_second'] for row in rows):.3g} in all"}
    behind = [row.get("evaluation_reward", row.get("reward", math.nan)) for row in rows]
    if all(map(math.isfinite, behind)) and min(behind) < max(behind):
        worst = behind.index(min(behind))
        told["behind"] = f"{names[worst]} with a return of {behind[worst]:.3g}"
    return told


def _spread(values: Sequence[float]) -> str:
    return f"{statistics.fmean(values):.3g}±{statistics.pstdev(values):.2g}"
