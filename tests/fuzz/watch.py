"""Watching a worker: whatever it does, its input is kept, it is ended, and another goes on."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import NamedTuple

from . import findings
from .bounds import SECONDS
from .findings import ROOT, Finding
from .judge import scratch_root
from .slot import Slot, State
from .worker import GREW

POLL = 0.05
IDLE = 180.0
"""Seconds that a worker may take to begin, and for anything else but inputs."""
MOST_DEATHS = 20
TICKS = os.sysconf("SC_CLK_TCK")
COVERAGE = re.compile(r"cov: (\d+)")


class Job(NamedTuple):
    """What to do with a target.

    Attributes:
        target: its name.
        folder: for findings and corpus.
        seconds: of guided search; 0 for none.
        count: of inputs drawn without guidance.
        seed: of both.
        replay: files to read instead of the kept ones.
        patience: seconds for an input.
    """

    target: str
    folder: Path
    seconds: float = 0.0
    count: int = 0
    seed: int = 0
    replay: Sequence[Path] = ()
    patience: float = SECONDS

    def command(self, scratch: Path, seconds: float) -> list[str]:
        corpus = self.folder / "corpus" / self.target
        corpus.mkdir(parents=True, exist_ok=True)
        options = {"scratch": scratch, "findings": self.folder / "findings", "corpus": corpus, "seconds": seconds}
        options |= {"count": self.count, "seed": self.seed}
        given = [f"--{name}={value}" for name, value in options.items()]
        replay = ["--replay", *map(str, self.replay)] if self.replay else []
        return [sys.executable, "-m", f"{__package__}.worker", self.target, *given, *replay]


@dataclass
class Result:
    """What came of a target so far.

    Attributes:
        target: its name.
        inputs: how many were read.
        seconds: for how long.
        coverage: branches reached; 0 where nobody counts.
        found: summary by name of the finding.
        failure: why no worker could work; empty for none.
    """

    target: str
    inputs: int = 0
    seconds: float = 0.0
    coverage: int = 0
    found: dict[str, str] = field(default_factory=dict)
    failure: str = ""


def watch(job: Job, stop: Event) -> Result:
    """Have workers do a job, one after the other, until it is done or its time is over."""
    result, begun, deaths = Result(job.target), time.monotonic(), 0
    with tempfile.TemporaryDirectory(prefix="rled-fuzz-", dir=scratch_root()) as scratch:
        room = Path(scratch)
        while not stop.is_set() and not result.failure and deaths < MOST_DEATHS:
            left = job.seconds - (time.monotonic() - begun)
            if deaths and job.seconds and left < 1.0:
                break
            finding = _work(job, room, max(left, 1.0) if job.seconds else 0.0, stop, result)
            _take_reports(room, result)
            if finding is None:
                break
            deaths += 1
            _keep_deadly(job, room, finding, result, stop)
    result.seconds = time.monotonic() - begun
    return result


def _work(job: Job, room: Path, seconds: float, stop: Event, result: Result) -> Finding | None:
    """Run one worker; return what ended it, if that was an input."""
    (room / "slot").unlink(missing_ok=True)
    slot = Slot(room / "slot")
    with (room / "log").open("wb") as log:
        process = subprocess.Popen(
            job.command(room, seconds),
            cwd=ROOT,
            env={**os.environ, "TMPDIR": str(room)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=log,
            process_group=0,
        )
    try:
        ended = _follow(process, slot, job, stop)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    state, log_text = slot.state(), (room / "log").read_text(errors="replace")
    result.inputs += state.ended
    result.coverage = max([result.coverage, *map(int, COVERAGE.findall(log_text))])
    if ended is not None and state.is_busy:
        return findings.of_stack("hang", ended, log_text.splitlines())
    if stop.is_set() or process.returncode == 0:
        return None
    if state.is_busy:
        return _death(process.returncode, log_text)
    result.failure = ended or " ".join(log_text.strip().splitlines()[-1:]) or f"exit code {process.returncode}"
    return None


def _follow(process: "subprocess.Popen[bytes]", slot: Slot, job: Job, stop: Event) -> str | None:
    """Wait for a worker's end; return why it was not waited for any longer."""
    spent, state = _Spent(process.pid), State(0, 0)
    while process.poll() is None and not stop.wait(POLL):
        spent.look()
        if (now := slot.state()) != state:
            spent, state = _Spent(process.pid), now
        elif now.is_busy and max(spent.worked, spent.waited) > job.patience:
            process.send_signal(signal.SIGUSR1)
            time.sleep(0.5)
            return f"worked {spent.worked:.0f} s and waited {spent.waited:.0f} s"
        elif not now.is_busy and spent.waited + spent.worked > IDLE:
            return "it does nothing"
    return None


class _Spent:
    """What a process does with its time from now on.

    Attributes:
        worked: seconds on a processor.
        waited: seconds in which it had nothing to do.
    """

    def __init__(self, process: int) -> None:
        self._process = process
        self.worked = self.waited = 0.0
        self._then, (self._begin, _) = time.monotonic(), self._read()

    def look(self) -> None:
        now, (processor, sleeps) = time.monotonic(), self._read()
        self.worked = processor - self._begin
        self.waited += now - self._then if sleeps else 0.0
        self._then = now

    def _read(self) -> tuple[float, bool]:
        try:
            values = Path(f"/proc/{self._process}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0, False
        return (int(values[11]) + int(values[12])) / TICKS, values[0] == "S"


def _death(code: int, log: str) -> Finding:
    lines = log.splitlines()
    if code == GREW:
        return Finding("growth", lines[-1], "")
    kind = signal.Signals(-code).name if code < 0 else f"exit{code}"
    begun = max((k for k, line in enumerate(lines) if line.startswith("Fatal Python error")), default=len(lines))
    said = lines[begun] if begun < len(lines) else " ".join(lines[-1:])
    return findings.of_stack(kind, f"the process ended by {kind}: {said}", lines[begun:])


def _keep_deadly(job: Job, room: Path, finding: Finding, result: Result, stop: Event) -> None:
    """Keep what ended a worker; a hang only if it is one without instrumentation too."""
    data = Slot(room / "slot").newest()
    if finding.kind != "hang" or not job.seconds or _hangs_plainly(job, data, stop):
        path = findings.keep(job.folder / "findings", job.target, finding, data)
        result.found[path.name] = f"{finding.summary}, at {finding.place}"
    with (room / "deadly").open("a") as file:
        print(findings.digest(data), file=file)


def _hangs_plainly(job: Job, data: bytes, stop: Event) -> bool:
    with tempfile.TemporaryDirectory(prefix="rled-fuzz-", dir=scratch_root()) as scratch:
        path = Path(scratch) / "input"
        path.write_bytes(data)
        alone = job._replace(seconds=0.0, count=0, replay=[path])
        return _work(alone, Path(scratch), 0.0, stop, Result(job.target)) is not None


def _take_reports(room: Path, result: Result) -> None:
    if (room / "found").exists():
        for line in (room / "found").read_text().splitlines():
            name, place, summary = line.split("\t", 2)
            result.found.setdefault(name, f"{summary}, at {place}")
