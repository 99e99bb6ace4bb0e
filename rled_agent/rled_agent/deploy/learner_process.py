"""Learning beside control: a process of its own takes transitions from a pipe and hands weights over.

The control process writes steps to this program's standard input and never waits: what does not fit into the pipe is
dropped and counted. Actor weights come back through ``SharedParameters``.
"""

import gc
import os
import select
import signal
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rled_msgs_py.errors import command_line
from rled_msgs_py.stopping import stop_requested

from rled_agent.deploy.shared_parameters import SharedParameters
from rled_agent.deploy.step_pipe import from_row, row_width
from rled_agent.methods import Problem, all_methods
from rled_agent.methods.td3 import TD3
from rled_agent.nn.draws import Draws
from rled_agent.nn.policy import load_policy, policy_file
from rled_agent.replay.mixture import Mixture, Part
from rled_agent.replay.transitions import Source
from rled_agent.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rled_agent.training.config import TrainConfig
from rled_agent.training.learning_state import (
    learning_state,
    origin_of,
    pack,
    part_of,
    require_origin,
    restore_learning,
    restoring,
    whole_number,
)
from rled_agent.training.run_directory import RunDirectory


@dataclass(frozen=True)
class Options:
    """Learn from the transitions on standard input; started by agent_node."""

    policy: Path
    """policy to begin with, which gives the sizes and the actor"""
    parameters: str
    """name of the shared memory for the actor's weights"""
    checkpoint: Path
    """state to continue from, and to save to at the end, on SIGUSR1 and once in a while"""
    train_after: int = 500
    """transitions before the first gradient step, when nothing was learned before"""
    updates_per_step: float = 1.0
    """gradient steps for each transition"""
    person_share: float = 0.25
    """share of each batch drawn from what a person did, once there is any (online knowledge, section 3.3)"""
    handover_every: int = 20
    """gradient steps between two hand-overs of weights"""
    save_every: float = 60.0
    """seconds between two savings: what a killed process loses at most"""
    seed: int = 0
    """of everything drawn"""


class LearnerProcess:
    """What learns beside control.

    It goes on from its own checkpoint; without one, from the run that the policy lies in: its method, settings, critics
    and replay. Demonstrations enter through the expert's actions among the transitions, not through its batches. What
    a person did is kept twice, so that it can make up a share of each batch.

    Args:
        options: settings.
    """

    def __init__(self, options: Options) -> None:
        policy, run = load_policy(options.policy), RunDirectory(policy_file(options.policy).parent)
        config = run.settings(all_methods()) if run.config_path.exists() else TrainConfig(TD3())
        method = config.method
        settings = replace(method.learner, actor=policy.network.architecture)  # type: ignore[attr-defined]
        method = replace(method, learner=settings)  # type: ignore[type-var]
        self.options, self._batch_size = options, config.schedule.batch_size
        sizes = policy.network.sizes[0], policy.network.sizes[-1]
        problem = Problem(*sizes, config.schedule.capacity, Draws([options.seed]))
        learning, self.by_person = method.learning(problem), problem.replay()
        batches = Mixture(learning.batches, Part(self.by_person, options.person_share))
        self._kept, self.learning = learning, learning._replace(batches=batches)
        self.learner, self.width = learning.learner, row_width(*sizes)
        self.learner.start_from(policy.network)
        before = next((path for path in (options.checkpoint, run.checkpoint_path) if path.exists()), None)
        if before is not None:
            self._go_on(read_checkpoint(before), before)
        self._origin = origin_of(options.policy)
        self._waiting = 0 if before is not None else options.train_after
        self._received = self._made = 0
        self._number = -1

    def _go_on(self, checkpoint: Checkpoint, path: Path) -> None:
        is_own = path == self.options.checkpoint
        if is_own:
            require_origin(checkpoint.state, path, self.options.policy)
        with restoring(str(path)):
            restore_learning(checkpoint, self._kept)
            self.learner.draws.taken = whole_number(part_of(checkpoint, "run"), "drawn")
            if is_own:
                self.by_person.load_state_dict(part_of(checkpoint, "by_person"))

    def add(self, rows: NDArray[np.float32]) -> None:
        """Store steps, rows as ``to_row`` makes them; one that does not follow the one before ends its episode."""
        for row in rows:
            step, number = from_row(row, self.learner.actor.sizes[0])
            step = step._replace(discount=step.discount * self.learning.gamma)
            if number != self._number + 1:
                self.learning.replay.cut()
            self._number = number
            self.learning.replay.add(step)
            if int(step.source) == Source.HUMAN:
                self.by_person.add(step)
        self._received += len(rows)

    def is_due(self) -> bool:
        """Whether a gradient step is owed."""
        owed = (self._received - self._waiting) * self.options.updates_per_step
        return self._made < owed and len(self.learning.replay) > 0

    def update(self) -> None:
        """One gradient step."""
        self.learning.update(self._batch_size)
        self._made += 1

    def save(self) -> None:
        """Write all state."""
        own = {"by_person": self.by_person.state_dict(), "run": {"drawn": self.learner.draws.taken}}
        write_checkpoint(self.options.checkpoint, pack(**learning_state(self._kept), **own, origin=self._origin))


def learn(process: LearnerProcess, parameters: SharedParameters, stop: Event, save: Event) -> None:
    """Take steps and make the gradient steps that are owed, until the input ends or ``stop`` is set."""
    source, width = sys.stdin.fileno(), process.width
    pending, saved = bytearray(), time.monotonic()  # whose parts tensors may share memory with
    while not stop.is_set():
        waiting = 0.0 if process.is_due() else 0.1
        if select.select([source], [], [], waiting)[0]:
            received = os.read(source, 1 << 16)
            if not received:
                break
            pending += received
            whole = len(pending) // (4 * width) * (4 * width)
            process.add(np.frombuffer(pending[:whole], dtype=np.float32).reshape(-1, width))
            pending = pending[whole:]
        if process.is_due():
            process.update()
            if process.learner.updates % process.options.handover_every == 0:
                parameters.put(process.learner.actor.vector())
        if save.is_set() or time.monotonic() - saved > process.options.save_every:
            save.clear()
            process.save()
            saved = time.monotonic()


@command_line
def main() -> None:
    """Run the process."""
    options = tyro.cli(Options, prog="learner_process")
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    process = LearnerProcess(options)
    weights = process.learner.actor.vector()
    parameters = SharedParameters(len(weights), options.parameters)
    parameters.put(weights)  # what was learned before acts at once
    gc.freeze()  # what the imports brought is never looked at again: a quicker end
    save = Event()
    signal.signal(signal.SIGUSR1, lambda *_: save.set())
    with stop_requested() as stop:
        learn(process, parameters, stop, save)
    process.save()
    parameters.close()


if __name__ == "__main__":
    main()
