"""Many jobs at once, each after those that it needs."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

from rled_msgs_py.errors import RledError

from rled_agent.experiments.jobs import Job, by_run


class Finished(NamedTuple):
    """The end of one job.

    Attributes:
        job: which.
        error: why it failed, None when it did not.
    """

    job: Job
    error: RledError | None


def sweep(
    jobs: Sequence[Job],
    make: Callable[[Job], Sequence[Path]],
    pool: Executor,
    tell: Callable[[Finished], None],
) -> None:
    """Make all jobs; what needs a failed one is left out.

    Args:
        jobs: to be made; what they need that none of them makes is there already.
        make: makes one.
        pool: takes as many as it can at once.
        tell: told of every end.
    """
    maker = by_run(jobs)
    sorter = TopologicalSorter({job: {maker[need] for need in job.needs if need in maker} for job in jobs})
    sorter.prepare()
    running: dict[Future[Sequence[Path]], Job] = {}
    while sorter.is_active():
        for job in sorter.get_ready():
            running[pool.submit(make, job)] = job
        if not running:
            return
        ended, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in ended:
            job, error = running.pop(future), future.exception()
            if error is not None and not isinstance(error, RledError):
                raise error
            tell(Finished(job, error))
            if error is None:
                sorter.done(job)
