"""Progress of long work: a bar on a terminal, a plain line for every tenth elsewhere."""

import sys

from tqdm import tqdm


class Progress:
    """Shows how much of something is done.

    Args:
        what: what is counted ("points marked").
        total: how many there will be.
    """

    def __init__(self, what: str, total: int) -> None:
        self._what, self._total = what, total
        self._bar = tqdm(desc=what, total=total, dynamic_ncols=True) if sys.stderr.isatty() else None
        self._tenth = 0

    def show(self, done: int) -> None:
        """Take note that ``done`` of them are done."""
        if self._bar is not None:
            self._bar.update(done - self._bar.n)
        elif self._total and (tenth := 10 * done // self._total) > self._tenth:
            self._tenth = tenth
            print(f"{done} of {self._total} {self._what}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Leave the bar as it is."""
        if self._bar is not None:
            self._bar.close()
