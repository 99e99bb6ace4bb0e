"""Steps on their way from the control process to the learner process, as rows of float32 through a pipe."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from rled_agent.replay.transitions import Source, Step

REST = 5
"""Numbers of a row behind state, action and next state."""


class RobotStep(NamedTuple):
    """One step of one robot, normalised.

    Attributes:
        observation: s, shape (o,).
        action: a, shape (n,).
        reward: r.
        discount: 1, or 0 where the task ended: who learns knows γ.
        next_observation: s', shape (o,).
        source: who acted.
        is_last: whether the episode ends with it.
        number: of the step in its episode.
    """

    observation: NDArray[np.float32]
    action: NDArray[np.float32]
    reward: float
    discount: float
    next_observation: NDArray[np.float32]
    source: Source
    is_last: bool
    number: int


class Numbered(NamedTuple):
    """A step with its place in its episode.

    Attributes:
        step: of a population of one.
        number: of the step in its episode.
    """

    step: Step
    number: int


def row_width(observation_size: int, action_size: int) -> int:
    """Numbers in a row."""
    return 2 * observation_size + action_size + REST


def to_row(step: RobotStep) -> NDArray[np.float32]:
    """One row."""
    rest = (step.reward, step.discount, step.source, step.is_last, step.number)
    return np.concatenate([step.observation, step.action, step.next_observation, rest], dtype=np.float32)


def from_row(row: NDArray[np.float32], observation_size: int) -> Numbered:
    """The step of a row; its tensors share memory with it."""
    o, one = observation_size, torch.from_numpy(row)[None]
    observation, action, following = one[:, :o], one[:, o : -REST - o], one[:, -REST - o : -REST]
    reward, discount, source, is_last, number = one[:, -REST:].unbind(dim=1)
    return Numbered(Step(observation, action, reward, discount, following, source, is_last > 0.5), int(number))
