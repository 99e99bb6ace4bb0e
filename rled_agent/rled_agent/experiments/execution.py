"""Making one run: its command as a child process, what it wrote, and how that was."""

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
from rled_agent.training.digests import file_digest

BEGUN, CHECKPOINT = "command.txt", "checkpoint.safetensors"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}
RESUMES = "train_agent"


class Stopped(RledError):
    """The run was asked to end before it was done; it goes on from there the next time."""


def execute(run: Run, root: Path, stop: Event) -> Path:
    """Make a run, or go on with one of the same command that was broken off, on one thread.

    Args:
        run: what to do; what it needs is there.
        root: folder of all runs.
        stop: set to end early.

    Returns:
        The run's folder, which holds ``run.json`` from now on.

    Raises:
        Stopped: ``stop`` was set.
        RledError: the command failed; its last lines are in the message.
    """
    folder = root / run.name.folder
    resuming = _can_go_on(folder, run, root)
    if not resuming:
        shutil.rmtree(folder, ignore_errors=True)
        write_whole(folder / BEGUN, _begun(run, root))
    program, *options = run.arguments(root)
    command = [sys.executable, "-m", f"rled_agent.cli.{program}", *options, *(["--resume"] if resuming else [])]
    begun = time.monotonic()
    with Children() as children:
        child = children.start(command, env=ONE_THREAD, echo=False)
        while child.exit_code is None:
            if stop.wait(10 * POLL_PERIOD):
                raise Stopped(f"{run.name} was stopped")
        children.check()
    record = {
        "command": list(run.command),
        "seconds": round(time.monotonic() - begun, 1),
        "resumed": resuming,
        "processor": processor(),
        "python": platform.python_version(),
    }
    write_whole(folder / RECORD, json.dumps(record, indent=2) + "\n")
    return folder


def _can_go_on(folder: Path, run: Run, root: Path) -> bool:
    begun = folder / BEGUN
    if run.command[0] != RESUMES or not (folder / CHECKPOINT).is_file() or not begun.is_file():
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
