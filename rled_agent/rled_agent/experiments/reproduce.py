"""Command: make the runs behind the figures of chapter 4, the seeds of a variant together in one process."""

import os
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Event
from typing import Annotated

import tyro
from rled_msgs_py.errors import RledError, command_line
from rled_msgs_py.outputs import require_output
from rled_msgs_py.stopping import stop_requested
from rled_msgs_py.validation import Range, check_fields

from rled_agent.experiments.archive import Archive, read_folder
from rled_agent.experiments.cluster import Cluster
from rled_agent.experiments.execution import execute, is_done
from rled_agent.experiments.experiment import Library, Run, RunName
from rled_agent.experiments.jobs import Job, jobs_of
from rled_agent.experiments.sweep import Finished, sweep
from rled_agent.nn.device import require_device
from rled_agent.training.progress import Progress

EXPERIMENTS, KEPT = Path("docs/results/experiments"), Path("docs/results/runs")


@dataclass(frozen=True)
class Options:
    """Make what is missing of the runs behind the figures named; run it in the project's folder.

    A run that is done is kept, one that was broken off goes on from its checkpoint. Settings and figures of each run
    end up in docs/results/runs, a file an experiment, from where draw_figures draws; weights stay in the folder of
    runs. With --anew, only what that folder holds counts as done.
    """

    figures: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """as 4.6, or another file of docs/results/experiments; all of them by default"""
    only: str = ""
    """make only runs whose name has this in it, as phi-0.1 or seed-0, and what they need"""
    runs: Path = Path("out/reproduce")
    """folder for the runs while they are made"""
    workers: Annotated[int, Range(1, 10_000)] = len(os.sched_getaffinity(0))
    """processes at once, each on one thread for several seeds; on a cluster as many as it has processors"""
    device: str = "cpu"
    """of the learning runs: cpu, or cuda, where one process makes all seeds of a variant"""
    ray: str = ""
    """address of a Ray cluster to make them on: auto, or ray://host:10001"""
    anew: bool = False
    """make again what docs/results/runs has"""
    show: bool = False
    """say what is missing and make nothing"""


@command_line
def main() -> None:
    """Run the command."""
    options = tyro.cli(Options, prog="reproduce")
    check_fields(options)
    require_device(options.device)
    if not options.show:
        require_output(options.runs, remedy="name another with --runs")
        require_output(KEPT, remedy="run it in the project's folder")
    library = Library(EXPERIMENTS)
    missing = _missing(library, options)
    print(f"{len(missing)} runs to make" + ("" if missing else "; --anew makes again what is kept"))
    if options.show:
        for run in missing.values():
            print(f"  {run.name}: {' '.join(run.command)}")
        return
    with stop_requested() as stop:
        make, workers = _maker(options, stop)
        jobs = jobs_of(missing, workers, options.device)
        with ThreadPoolExecutor(workers) as pool:
            failed = _make(jobs, options.runs, make, pool)
    if failed:
        raise RledError(f"{len(failed)} of {len(missing)} runs are not done: {', '.join(failed)}", "", "run it again")


def _missing(library: Library, options: Options) -> dict[RunName, Run]:
    """Runs that are not kept yet, and what these need, if its weights are not there."""
    is_kept = partial(is_done, options.runs) if options.anew else Archive(KEPT).has
    asked = library.with_needs(list(options.figures) or library.names())
    missing = {name: run for name, run in asked.items() if options.only in str(name) and not is_kept(run)}
    waiting = [need for run in missing.values() for need in run.needs]
    while waiting:
        need = waiting.pop()
        if need not in missing and not is_done(options.runs, asked[need]):
            missing[need] = asked[need]
            waiting += asked[need].needs
    return missing


def _maker(options: Options, stop: Event) -> tuple[Callable[[Job], list[Path]], int]:
    """What makes one job, and how many are made at once."""
    if not options.ray:
        return partial(execute, root=options.runs, stop=stop), options.workers if options.device == "cpu" else 1
    cluster = Cluster(options.ray, options.runs, stop, options.device)
    return cluster.make, cluster.processors


def _make(jobs: list[Job], root: Path, make: Callable[[Job], list[Path]], pool: Executor) -> list[str]:
    """Make the jobs; returns the names of the runs that failed or were stopped."""
    failed: list[str] = []
    done, archive = 0, Archive(KEPT)

    def tell(finished: Finished) -> None:
        nonlocal done
        done += len(finished.job.runs)
        for run in finished.job.runs:
            if is_done(root, run):  # of a population whose command failed, some may be
                archive.add(read_folder(root / run.name.folder, run.name))
            else:
                failed.append(str(run.name))
        if finished.error is not None:
            print(f"{finished.job}: {finished.error}", flush=True)
        progress.say(done, {"failed": len(failed)})

    with Progress("run", sum(len(job.runs) for job in jobs)) as progress:
        sweep(jobs, make, pool, tell)
    return failed


if __name__ == "__main__":
    main()
