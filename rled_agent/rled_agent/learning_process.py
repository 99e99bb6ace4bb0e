"""Learning beside control: a process of its own takes transitions from a pipe and hands weights over.

The control process writes rows of a replay buffer to this program's standard input, each with a 1 behind it where a
person acted, and never waits: what does not fit into the pipe is dropped and counted. Actor weights come back through a
``WeightSlot``.
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

from rled_agent.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rled_agent.config import TrainConfig
from rled_agent.learners.td3 import Learner
from rled_agent.learning_state import origin_of, pack, require_origin, restoring, unpack
from rled_agent.policy import load_policy, policy_file
from rled_agent.replay import Batch, Replay
from rled_agent.run_directory import RunDirectory
from rled_agent.weight_slot import WeightSlot

PERSON_ROWS = "person.rows"


@dataclass(frozen=True)
class Options:
    """Learn from the transitions on standard input; started by agent_node."""

    policy: Path
    """policy to begin with, which gives the sizes and the actor"""
    slot: str
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


class Student:
    """Learner and replay of the learning process.

    It goes on from its own checkpoint; without one, from the run that the policy lies in: its settings, critics and
    replay. Demonstrations enter through the expert's actions among the transitions, not through its batches.

    Args:
        options: settings.
    """

    def __init__(self, options: Options) -> None:
        policy, run = load_policy(options.policy), RunDirectory(policy_file(options.policy).parent)
        config = run.settings() if run.config_path.exists() else TrainConfig()
        sizes = policy.network.sizes[0], policy.network.sizes[-1]
        settings = replace(config.learner, actor=policy.network.architecture)
        self.options, self._batch_size = options, config.schedule.batch_size
        self.learner = Learner(*sizes, settings, torch.Generator().manual_seed(options.seed))
        self.replay = Replay(*sizes, config.schedule.capacity)
        self.replay.rows.fill(0.0)  # takes all its memory now, not hours later
        self.by_person = Replay(*sizes, config.schedule.capacity)
        for actor in (self.learner.actor, self.learner.target_actor):
            actor.load_state_dict(policy.network.state_dict())
        before = next((path for path in (options.checkpoint, run.checkpoint_path) if path.exists()), None)
        if before is not None:
            checkpoint = read_checkpoint(before)
            if before == options.checkpoint:
                require_origin(checkpoint.state, before, options.policy)
            unpack(checkpoint, self.learner, self.replay)
            if PERSON_ROWS in checkpoint.tensors:
                with restoring(str(before)):
                    self.by_person.extend(checkpoint.tensors[PERSON_ROWS].numpy())
        self._origin = origin_of(options.policy)
        self._waiting = 0 if before is not None else options.train_after
        self._received = self._made = 0

    def add(self, rows: NDArray[np.float32]) -> None:
        """Store transitions, rows as in ``Replay`` and behind each 1 where a person acted; those are kept twice."""
        self.replay.extend(rows[:, :-1])
        self.by_person.extend(rows[rows[:, -1] > 0.0, :-1])
        self._received += len(rows)

    def is_due(self) -> bool:
        """Whether a gradient step is owed."""
        return self._made < (self._received - self._waiting) * self.options.updates_per_step

    def update(self) -> None:
        """One gradient step."""
        by_person = round(self._batch_size * self.options.person_share) if len(self.by_person) else 0
        batch = self.replay.sample(self._batch_size - by_person, self.learner.generator)
        if by_person:
            demonstrated = self.by_person.sample(by_person, self.learner.generator)
            rows = torch.cat((batch.rows, demonstrated.rows))
            batch = Batch(rows, batch.observation_size, batch.action_size, by_person)
        self.learner.update(batch)
        self._made += 1

    def save(self) -> None:
        """Write all state."""
        tensors, state = pack(self.learner, self.replay)
        rows = torch.from_numpy(self.by_person.rows[: len(self.by_person)])
        write_checkpoint(self.options.checkpoint, Checkpoint(tensors | {PERSON_ROWS: rows}, state | self._origin))


def learn(student: Student, slot: WeightSlot, stop: Event, save: Event) -> None:
    """Take transitions and make the gradient steps that are owed, until the input ends or ``stop`` is set."""
    source, width = sys.stdin.fileno(), student.replay.rows.shape[1] + 1
    pending, saved = b"", time.monotonic()
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
                slot.put(student.learner.actor.vector())
        if save.is_set() or time.monotonic() - saved > student.options.save_every:
            save.clear()
            student.save()
            saved = time.monotonic()


@command_line
def main() -> None:
    """Run the process."""
    options = tyro.cli(Options, prog="learning_process")
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    student = Student(options)
    weights = student.learner.actor.vector()
    slot = WeightSlot(len(weights), options.slot)
    slot.put(weights)  # what was learned before acts at once
    gc.freeze()  # what the imports brought is never looked at again: a quicker end
    save = Event()
    signal.signal(signal.SIGUSR1, lambda *_: save.set())
    with stop_requested() as stop:
        learn(student, slot, stop, save)
    student.save()
    slot.close()


if __name__ == "__main__":
    main()
