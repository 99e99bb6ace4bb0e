"""What the keyboard operator's terminal shows."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick

from rled_teleop.operators.keys import Keyboard, KeyMotion

Vector = NDArray[np.float64]
RULE = "-" * 72
HELP = (
    "w/s x+ x-   a/d y+ y-   r/f z+ z-      move the end effector",
    "1-9 choose a joint   right/left or ./,  turn it      +/- faster, slower",
    "b begin episode   n end it   k keep   x discard   m mark pose",
    "Q quit   any other key stops; letting go stops too",
)


class ScreenState(NamedTuple):
    """What the screen is drawn from.

    Attributes:
        task: robot and task.
        tick: the newest state.
        motion: what is moved now.
        delta: newest displacement (rad), shape (n,).
        recorder: what the recorder answered last.
    """

    task: TaskDescription
    tick: Tick
    motion: KeyMotion | None
    delta: Vector | None
    recorder: str


def waiting_screen(awaited: str, recorder: str) -> list[str]:
    """Lines to show before there is a simulation."""
    return [RULE, f"waiting for {awaited}", f"recorder: {recorder}", RULE, *HELP]


def screen(keyboard: Keyboard, shown: ScreenState) -> list[str]:
    """Lines to show."""
    tick, task = shown.tick, shown.task
    q = tick.joints.ordered(task.joint_names).position
    distance = float(np.linalg.norm((tick.target.position - tick.ee.position)[list(task.axes)]))
    status = tick.status
    return [
        RULE,
        f"{task.robot}  t {tick.stamp * 1e-9:8.2f} s  episode {status.episode}  step {status.step}  "
        f"reached {status.targets_reached}{'  RISKY' if status.risky else ''}",
        f"{describe(keyboard, task, shown.motion):40} speed {100 * keyboard.share:.3g} %",
        f"end effector {_vector(tick.ee.position)} m   target {_vector(tick.target.position)} m",
        f"distance {distance:.3f} m   largest step {_largest(shown.delta):.4f} of {task.max_delta:g} rad",
        "joints " + " ".join(f"{'>' if k == keyboard.joint else ''}{angle:+.3f}" for k, angle in enumerate(q)) + " rad",
        f"recorder: {shown.recorder}",
        RULE,
        *HELP,
    ]


def describe(keyboard: Keyboard, task: TaskDescription, motion: KeyMotion | None) -> str:
    """What is moved, or why a key moves nothing, in words."""
    if keyboard.refused:
        return keyboard.refused
    if motion is None:
        return f"still (joint {keyboard.joint + 1}: {task.joint_names[keyboard.joint]})"
    if motion.joint is not None:
        return f"turning {task.joint_names[motion.joint]} {'+' if motion.direction[0] > 0 else '-'}"
    axis = int(np.abs(motion.direction).argmax())
    return f"moving {'xyz'[axis]} {'+' if motion.direction[axis] > 0 else '-'}"


def _vector(values: Vector) -> str:
    return "(" + ", ".join(f"{value:+.3f}" for value in values) + ")"


def _largest(delta: Vector | None) -> float:
    return 0.0 if delta is None else float(np.abs(delta).max(initial=0.0))
