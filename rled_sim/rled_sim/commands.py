"""Which displacement commands are taken, and why the others are refused."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.records import DeltaCommand
from rled_msgs_py.task import TaskDescription

ROUNDING = 1e-6
"""Share by which a component may pass Δq_max: a policy's float32 number is rounded up to there. It is then clipped."""


class Code(IntEnum):
    """What became of a command or a request, as ``/diagnostics`` reports it."""

    ACCEPTED = 0
    UNREADABLE = 1
    WRONG_NAMES = 2
    TOO_LARGE = 3
    STALE = 4
    FUTURE = 5
    STOPPED = 6
    EPISODE_OVER = 7
    JOINT_RANGE = 8
    VELOCITY = 9
    ACCELERATION = 10
    WORKSPACE = 11
    KEEP_OUT = 12
    SELF_COLLISION = 13
    CONTACT = 14
    TARGET = 15


class Refused(RledError):
    """A command that is not carried out.

    Args:
        code: the reason, for programs.
        what: the reason, for people.
        accepted: what would have been taken.
    """

    def __init__(self, code: Code, what: str, accepted: str = "") -> None:
        super().__init__(what, accepted)
        self.code = code

    @property
    def name(self) -> str:
        """The code in words, as in ``keep_out``."""
        return self.code.name.lower()


def displacement(command: DeltaCommand, task: TaskDescription) -> list[float]:
    """Δq (rad) of a command in the robot's joint order, n.

    A component beyond Δq_max refuses the whole command: clipped, it would be another motion than the one asked for, and
    the bag would not say so.

    Raises:
        Refused: joints missing or unknown, or a component beyond Δq_max.
    """
    try:
        delta = command.ordered(task.joint_names).delta
    except ContractError as error:
        raise Refused(Code.WRONG_NAMES, str(error)) from None
    if (refused := too_large(delta, task.max_delta)) is not None:
        raise refused
    values: list[float] = delta.tolist()
    return values


def too_large(delta: NDArray[np.float64], max_delta: float) -> Refused | None:
    """The refusal of a displacement (rad), shape (n,), with a component beyond Δq_max (rad)."""
    largest = max(map(abs, delta.tolist()))
    if largest <= max_delta * (1.0 + ROUNDING):
        return None
    return Refused(Code.TOO_LARGE, f"a displacement of {largest:.6g} rad", f"at most {max_delta:g} rad")
