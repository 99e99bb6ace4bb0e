"""Stamps that fall back, and moments that go on all the same."""

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]


def fallen_back(stamps: Times) -> NDArray[np.bool_]:
    """Where a stamp is less than the one before and what follows does not make it good, shape (k,)."""
    back = np.diff(stamps, prepend=stamps[:1]) < 0
    return back & ~interleaved(stamps)


def interleaved(stamps: Times) -> NDArray[np.bool_]:
    """Where a stamp is less than the one before, but the next one is not: as when two publishers take turns."""
    back = np.diff(stamps, prepend=stamps[:1]) < 0
    returns = np.zeros(len(stamps), dtype=bool)
    returns[1:-1] = stamps[2:] >= stamps[:-2]
    return back & returns


def going_on(stamps: Times) -> Times:
    """Moments: the stamps, each run that began anew moved to just after the run before it (ns), shape (k,)."""
    fallen = fallen_back(stamps)
    if not fallen.any():
        return stamps
    steps = np.diff(stamps)
    usual = int(np.median(steps[steps > 0])) if (steps > 0).any() else 1
    falls = np.zeros(len(stamps), np.int64)
    falls[1:] = np.where(fallen[1:], usual - steps, 0)
    moments: Times = stamps + np.cumsum(falls)
    return moments
