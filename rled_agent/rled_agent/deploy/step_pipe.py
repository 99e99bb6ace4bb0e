"""Steps on their way from the control process to the learner process, as rows of float32 through a pipe."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rled_agent.replay.transitions import Source, Step

REST = 5
"""Numbers of a row behind state, action and next state."""


class Numbered(NamedTuple):
    """A step with its place in its episode.

    Attributes:
        step: with a discount of 1, or 0 where the task ended: who learns knows γ.
        number: of the step in its episode.
    """

    step: Step
    number: int


def row_width(observation_size: int, action_size: int) -> int:
    """Numbers in a row."""
    return 2 * observation_size + action_size + REST


def to_row(numbered: Numbered) -> NDArray[np.float32]:
    """One row."""
    step = numbered.step
    rest = (step.reward, step.discount, step.source, step.is_last, numbered.number)
    return np.concatenate([step.observation, step.action, step.next_observation, rest], dtype=np.float32)


def from_row(row: NDArray[np.float32], observation_size: int) -> Numbered:
    """The step of a row; its arrays are views."""
    o = observation_size
    reward, discount, source, is_last, number = row[-REST:].tolist()
    observation, action, following = row[:o], row[o : -REST - o], row[-REST - o : -REST]
    step = Step(observation, action, reward, discount, following, Source(int(source)), bool(is_last))
    return Numbered(step, int(number))
