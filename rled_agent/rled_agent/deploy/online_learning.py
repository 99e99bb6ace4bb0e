"""Learning beside control: switched on and off, fed with what was answered, saved."""

from pathlib import Path
from threading import Thread
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.outputs import require_output
from rled_msgs_py.records import Actor, TaskStatus

from rled_agent.deploy.learner_client import LearnerClient
from rled_agent.deploy.step_pipe import RobotStep
from rled_agent.nn.policy import Policy
from rled_agent.replay.transitions import Source
from rled_agent.training.checkpoint import read_state
from rled_agent.training.learning_state import require_origin

Vector = NDArray[np.float64]
SAVING = 10.0
"""Seconds that the learning process is given to write its state when the node ends."""
SAVING_ALONE = 120.0
"""The same when it is switched off: nobody waits for it, and on a busy machine it comes last."""


class Answered(NamedTuple):
    """A state and its answer.

    Attributes:
        status: of the task in that state.
        observation: the state vector, shape (o,).
        delta: Δq (rad), shape (n,).
        actor: who answered.
    """

    status: TaskStatus
    observation: Vector
    delta: Vector
    actor: Actor


class OnlineLearning:
    """The learning process of a policy, if there is one just now.

    Args:
        policy: its network takes the learned weights.
        agent: file of the policy; empty when it is an expert, which does not learn.
        state: where the process keeps its state.
        priority: which share of the processors it takes.
    """

    def __init__(self, policy: Policy, agent: str, state: str, priority: str) -> None:
        self._policy, self._agent, self._state, self._priority = policy, agent, Path(state), priority
        self._closing: Thread | None = None
        self.client: LearnerClient | None = None

    def start(self) -> None:
        """Start the learning process, which goes on from its saved state.

        Raises:
            RledError: there is nothing that could learn, the process before has not saved its state yet, or what is
                saved is another policy's.
        """
        if self._closing is not None and self._closing.is_alive():
            raise RledError("the learning process is saving its state", remedy="call again in some seconds")
        if not self._agent:
            raise RledError("the expert does not learn", remedy="start with --agent POLICY")
        require_output(self._state.parent, self._state.name, remedy="name another --learning-state")
        if self._state.exists():
            require_origin(read_state(self._state), self._state, Path(self._agent))
        self.client = LearnerClient(self._policy.network, Path(self._agent), self._state, self._priority)

    def switch(self, on: bool) -> None:
        """Learn or not; a process that has died is replaced.

        Raises:
            RledError: as ``start``.
        """
        before = self.client
        if before is not None and not (on and before.running):
            self._closing = Thread(target=before.close, args=(SAVING_ALONE,), daemon=True)
            self._closing.start()  # it saves its state first, and control does not wait
            if not before.running:
                self._closing.join()
            self.client = None
        if on and self.client is None:
            self.start()

    def go_on(self, before: Answered | None, status: TaskStatus, observation: Vector) -> None:
        """Offer the transition that this state ends, and take newer weights."""
        if self.client is None:
            return
        if before is not None and _follows(status, before.status):
            scaling = self._policy.scaling
            state, following = map(scaling.normalize_observation, (before.observation, observation))
            action, discount, source = scaling.normalize_action(before.delta), 1.0 - status.terminated, _source(before)
            is_last = status.terminated or status.truncated
            rest = status.reward, discount, following, source, is_last, status.step
            self.client.offer(RobotStep(state, action, *rest))
        self.client.refresh()

    def save(self) -> Path:
        """Save the policy as it is now, and ask the process to save its state; the folder of both.

        Raises:
            OSError, RledError: the policy could not be written.
        """
        if self.client is not None and not self.client.running:
            raise RledError("the learning process has ended", "", "see what it said, and call ~/learn again")
        if self.client is not None:
            self.client.save()
        self._policy.save(self._state.with_name("policy.safetensors"))
        return self._state.parent

    def close(self) -> None:
        """End the process, which saves its state; one that was switched off may be at it still."""
        if self._closing is not None:
            self._closing.join(SAVING)
        if self.client is not None:
            self.client.close(SAVING if self.client.started else 0.0)


def _source(answered: Answered) -> Source:
    """HOLD is nobody's wish, but it is what the policy led to."""
    return {Actor.HUMAN: Source.HUMAN, Actor.EXPERT: Source.EXPERT}.get(answered.actor, Source.AGENT)


def _follows(after: TaskStatus, before: TaskStatus) -> bool:
    return after.episode == before.episode and after.step == before.step + 1
