"""Learning beside control: a process of its own takes transitions from a pipe and hands weights over.

The control process writes rows of a replay buffer to this program's standard input and never waits: what does not fit
into the pipe is dropped and counted. Actor weights come back through a ``WeightSlot``.
"""

import os
import select
import signal
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from rled_msgs_py.errors import command_line
from rled_msgs_py.stopping import stop_requested

from rled_agent.checkpoint import read_checkpoint, write_checkpoint
from rled_agent.learner import Learner, LearnerConfig
from rled_agent.learning_state import pack, unpack
from rled_agent.policy import load_policy
from rled_agent.replay import Replay
from rled_agent.weight_slot import WeightSlot


@dataclass(frozen=True)
class Options:
    """Learn from the transitions on standard input; started by agent_node."""

    policy: Path
    """policy to begin with, which gives the sizes and the actor"""
    slot: str
    """name of the shared memory for the actor's weights"""
    checkpoint: Path
    """state to continue from, and to save to at the end and on SIGUSR1"""
    train_after: int = 500
    """transitions before the first gradient step"""
    updates_per_step: float = 1.0
    """gradient steps for each transition"""
    batch_size: int = 100
    """transitions in a gradient step"""
    capacity: int = 200_000
    """transitions kept for replay"""
    handover_every: int = 20
    """gradient steps between two hand-overs of weights"""
    seed: int = 0
    """of everything drawn"""
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    """settings of the update; the actor's network is that of the policy"""


class Student:
    """Learner and replay of the learning process.

    Args:
        options: settings.
    """

    def __init__(self, options: Options) -> None:
        policy = load_policy(options.policy)
        sizes = policy.network.sizes[0], policy.network.sizes[-1]
        settings = replace(options.learner, actor=policy.network.architecture)
        self.options = options
        self.learner = Learner(*sizes, settings, torch.Generator().manual_seed(options.seed))
        self.learner.actor.parameters.copy_(policy.network.parameters)
        self.learner.target_actor.parameters.copy_(policy.network.parameters)
        self.replay = Replay(*sizes, options.capacity)
        if options.checkpoint.exists():
            unpack(read_checkpoint(options.checkpoint), self.learner, self.replay)

    def add(self, rows: NDArray[np.float32]) -> None:
        """Store transitions, rows as in ``Replay``."""
        for row in rows:
            self.replay.rows[self.replay.added % self.replay.capacity] = row
            self.replay.added += 1

    def is_due(self) -> bool:
        """Whether a gradient step is owed."""
        owed = (self.replay.added - self.options.train_after) * self.options.updates_per_step
        return self.learner.updates < owed

    def update(self) -> None:
        """One gradient step."""
        self.learner.update(self.replay.sample(self.options.batch_size, self.learner.generator))

    def save(self) -> None:
        """Write all state."""
        write_checkpoint(self.options.checkpoint, pack(self.learner, self.replay))


def learn(student: Student, slot: WeightSlot, stop: Event, save: Event) -> None:
    """Take transitions and make the gradient steps that are owed, until the input ends or ``stop`` is set."""
    source, width = sys.stdin.fileno(), student.replay.rows.shape[1]
    pending = b""
    while not stop.is_set():
        waiting = 0.0 if student.is_due() else 0.1
        if select.select([source], [], [], waiting)[0]:
            received = os.read(source, 1 << 16)
            if not received:
                break
            pending += received
            whole = len(pending) // (4 * width) * (4 * width)
            student.add(np.frombuffer(pending[:whole], dtype=np.float32).reshape(-1, width))
            pending = pending[whole:]
        if student.is_due():
            student.update()
            if student.learner.updates % student.options.handover_every == 0:
                slot.put(student.learner.actor.parameters.numpy())
        if save.is_set():
            save.clear()
            student.save()


@command_line
def main() -> None:
    """Run the process."""
    options = tyro.cli(Options, prog="learning_process")
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    student = Student(options)
    slot = WeightSlot(len(student.learner.actor.parameters), options.slot)
    save = Event()
    signal.signal(signal.SIGUSR1, lambda *_: save.set())
    with stop_requested() as stop:
        learn(student, slot, stop, save)
    student.save()
    slot.close()


if __name__ == "__main__":
    main()
