"""Making the runs of a job: its command as a child process, what it wrote, and how that was."""

import json
import platform
import shlex
import shutil
import sys
import time
from pathlib import Path
from threading import Event

from rled_msgs_py.errors import RledError
from rled_msgs_py.files import write_whole
from rled_msgs_py.processes import POLL_PERIOD, Children
from rled_msgs_py.untrusted import read_json, read_text

from rled_agent.experiments.archive import RECORD, is_record
from rled_agent.experiments.experiment import Run
from rled_agent.experiments.jobs import POPULATES, Job
from rled_agent.training.digests import file_digest

BEGUN, CHECKPOINT, DIVERGED = "command.txt", "checkpoint.safetensors", "diverged.json"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class Stopped(RledError):
    """The run was asked to end before it was done; it goes on from there the next time."""


def execute(job: Job, root: Path, stop: Event) -> list[Path]:
    """Make the runs of a job, or go on with those of the same command that were broken off, on one thread.

    Args:
        job: what to do; what it needs is there.
        root: folder of all runs.
        stop: set to end early.

    Returns:
        The folder of each run, which holds ``run.json`` from now on.

    Raises:
        Stopped: ``stop`` was set.
        RledError: the command failed; its last lines are in the message.
    """
    begun = tuple(run for run in job.runs if _can_go_on(root / run.name.folder, run, root))
    anew = tuple(run for run in job.runs if run not in begun)
    for run in anew:
        folder = root / run.name.folder
        shutil.rmtree(folder, ignore_errors=True)
        write_whole(folder / BEGUN, _begun(run, root))
    for runs in (begun, anew):
        if runs:
            _execute(job._replace(runs=runs), root, stop, resuming=runs is begun)
    return [root / run.name.folder for run in job.runs]


def _execute(job: Job, root: Path, stop: Event, *, resuming: bool) -> None:
    program, *options = job.arguments(root)
    command = [sys.executable, "-m", f"rled_agent.cli.{program}", *options, *(["--resume"] if resuming else [])]
    hidden = {} if job.device != "cpu" else {"CUDA_VISIBLE_DEVICES": ""}
    begun = time.monotonic()
    try:
        _run(command, ONE_THREAD | hidden, job, stop)
    except Stopped:
        raise
    except RledError:
        diverged = [run for run in job.runs if (root / run.name.folder / DIVERGED).exists()]
        for run in job.runs if diverged else ():
            if run not in diverged:  # the others of a population go on to their end
                _record(run, job, root, (time.monotonic() - begun) / len(job.runs), resuming)
        raise
    for run in job.runs:
        _record(run, job, root, (time.monotonic() - begun) / len(job.runs), resuming)


def _run(command: list[str], env: dict[str, str], job: Job, stop: Event) -> None:
    with Children() as children:
        child = children.start(command, env=env, echo=False)
        while child.exit_code is None:
            if stop.wait(10 * POLL_PERIOD):
                raise Stopped(f"{job} was stopped")
        children.check()


def _record(run: Run, job: Job, root: Path, seconds: float, resuming: bool) -> None:
    record = {
        "command": list(run.command),
        "seconds": round(seconds, 1),
        "population": len(job.runs),
        "device": job.device,
        "resumed": resuming,
        "processor": processor(),
        "python": platform.python_version(),
    }
    write_whole(root / run.name.folder / RECORD, json.dumps(record, indent=2) + "\n")


def _can_go_on(folder: Path, run: Run, root: Path) -> bool:
    begun = folder / BEGUN
    if run.command[0] != POPULATES or not (folder / CHECKPOINT).is_file() or not begun.is_file():
        return False
    return begun.read_text(encoding="utf-8") == _begun(run, root)


def _begun(run: Run, root: Path) -> str:
    """The command, and what is in the weights of other runs that it reads."""
    weights = (path for need in run.needs for path in sorted((root / need.folder).glob("*.safetensors")))
    read = [f"{path.relative_to(root)} {file_digest(path)}" for path in weights if path.name != CHECKPOINT]
    return "\n".join([shlex.join(run.command), *read])


def is_done(root: Path, run: Run) -> bool:
    """The run was made there, by the same command as now."""
    try:
        record = read_json(read_text(root / run.name.folder / RECORD, RECORD), RECORD)
    except (OSError, RledError):
        return False
    return is_record(record) and record["command"] == list(run.command)


def processor() -> str:
    """The processor's name."""
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
