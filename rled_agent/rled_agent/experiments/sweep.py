"""Many runs at once, each after those that it needs."""

from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

from rled_msgs_py.errors import RledError

from rled_agent.experiments.experiment import Run, RunName


class Finished(NamedTuple):
    """The end of one run.

    Attributes:
        name: which run.
        error: why it failed, None when it did not.
    """

    name: RunName
    error: RledError | None


def sweep(
    runs: Mapping[RunName, Run],
    make: Callable[[Run], Path],
    pool: Executor,
    tell: Callable[[Finished], None],
) -> None:
    """Make all runs; what needs a failed one is left out.

    Args:
        runs: to be made, by name; a need that is not among them is there already.
        make: makes one run.
        pool: takes as many as it can at once.
        tell: told of every end.
    """
    sorter = TopologicalSorter({name: [need for need in run.needs if need in runs] for name, run in runs.items()})
    sorter.prepare()
    running: dict[Future[Path], RunName] = {}
    while sorter.is_active():
        for name in sorter.get_ready():
            running[pool.submit(make, runs[name])] = name
        if not running:
            return
        ended, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in ended:
            name, error = running.pop(future), future.exception()
            if error is not None and not isinstance(error, RledError):
                raise error
            tell(Finished(name, error))
            if error is None:
                sorter.done(name)
