"""The control side of learning: starts the learning process, offers it transitions, takes its weights."""

import contextlib
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np

from rled_agent.deploy.shared_parameters import SharedParameters
from rled_agent.deploy.step_pipe import RobotStep, to_row
from rled_agent.nn.perceptron import Perceptron

PRIORITIES = ("idle", "low")
"""The learning process runs on processors that nothing else wants (SCHED_IDLE), or is a nice one."""
NICENESS = 10


class LearnerClient:
    """A running learning process; no call waits for it but ``close``.

    Args:
        actor: network that acts; its weights are replaced as the process learns.
        policy: file of that network.
        checkpoint: where the process keeps its state.
        priority: one of ``PRIORITIES``.
    """

    def __init__(self, actor: Perceptron, policy: Path, checkpoint: Path, priority: str = "idle") -> None:
        self._actor = actor
        self._weights = actor.vector()
        self._parameters = SharedParameters(len(self._weights))
        self.offered = self.dropped = self.handovers = 0
        command = [sys.executable, "-m", "rled_agent.deploy.learner_process", "--policy", str(policy)]
        command += ["--parameters", self._parameters.name, "--checkpoint", str(checkpoint)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, process_group=0, preexec_fn=partial(_prepare, priority)
        )
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)

    @property
    def running(self) -> bool:
        """The process is alive."""
        return self._process.poll() is None

    @property
    def started(self) -> bool:
        """The process has loaded what was learned before; that is the first thing that it hands over."""
        self.refresh()
        return self.handovers > 0

    def offer(self, step: RobotStep) -> None:
        """Send one step; a full pipe drops it.

        One that is not finite is dropped too: a single one would spoil every weight.
        """
        self.offered += 1
        row = to_row(step)
        if not np.isfinite(row).all():
            self.dropped += 1
            return
        try:
            os.write(self._pipe, row.tobytes())  # whole or not at all: shorter than PIPE_BUF
        except (BlockingIOError, BrokenPipeError):
            self.dropped += 1

    def refresh(self) -> None:
        """Take newer weights into the actor, if there are any."""
        if self._parameters.take(self._weights):
            self._actor.load_vector(self._weights)
            self.handovers += 1

    def save(self) -> None:
        """Ask the process to write its state."""
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGUSR1)

    def close(self, patience: float) -> None:
        """End the process: it writes its state first, unless that takes it longer than ``patience`` seconds."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._parameters.close()


def _prepare(priority: str) -> None:
    """In the new process, before it runs its program."""
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # it would end a program that does not listen to it yet
    if priority == "idle":
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    else:
        os.nice(NICENESS)
