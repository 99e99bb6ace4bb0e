"""Robot and task together: the decision process that both the environments and the node step."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import PoseSample
from rled_msgs_py.task_limits import NO_LIMITS

from rled_sim.commands import Refused
from rled_sim.draws import index
from rled_sim.episode_state import Episode, Outcome
from rled_sim.motion_guard import Guard
from rled_sim.plant import Plant
from rled_sim.starts import start_points
from rled_sim.target_request import requested_target
from rled_sim.tasks import ReachTask


class Simulation:
    """One robot at one task; ``reset`` comes first.

    The same generator state and the same displacements give the same numbers, bit for bit.

    Attributes:
        plant: the robot.
        task: what it is to do.
        episode: how far it has come.
        refused: why the last displacement was not carried out; None when it was.
    """

    def __init__(self, plant: Plant, task: ReachTask, start_joints: ArrayLike | None = None) -> None:
        """Join a robot and a task.

        Args:
            plant: the robot; whoever made it closes it.
            task: the robot's task.
            start_joints: joint angles that episodes start at (rad), shape (k, n); the robot's home when None.

        Raises:
            RledError: start joints of another shape, or outside the joint limits.
        """
        self.plant, self.task = plant, task
        self._starts = (
            [list(plant.robot.home)] if start_joints is None else start_points(start_joints, task.description)
        )
        self._max_delta, self._size = task.description.max_delta, task.description.action_size
        self._guard = self._make_guard()
        self._rng: np.random.Generator | None = None
        self.refused: Refused | None = None
        self._previous: Sequence[float] = [0.0] * self._size

    def _make_guard(self) -> Guard | None:
        task = self.task.description
        return None if task.limits == NO_LIMITS else Guard(task, self.plant.robot.chain, self.plant.touches)

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode: draw the start, then the target; ``rng`` draws the next targets too.

        Each draw is one ``rng.random()``, whatever there is to choose from.
        """
        self._rng = rng
        self.plant.place(self._starts[index(rng, len(self._starts))])
        self._rest()
        self.episode = Episode(self.task, self.plant.q, self.plant.position, self.task.draw_target(rng))

    def step(self, delta: Sequence[float]) -> Outcome:
        """Displace the joints by Δq (rad), n, clipped to ±Δq_max, and count the transition.

        Where a limit forbids it, the robot stays, and the step counts all the same: whoever learns sees that the action
        led nowhere, and nobody waits for one within the limits.

        Raises:
            RledError: another number of joints, a NaN or an infinity, or no episode has begun.
        """
        if self._rng is None:
            raise RledError("no episode has begun", "", "call reset first")
        if len(delta) != self._size or not math.isfinite(sum(delta)):
            raise RledError(f"displacement {list(delta)}", f"{self._size} finite numbers (rad)")
        largest = self._max_delta
        moved = [-largest if each < -largest else largest if each > largest else each for each in delta]
        if self._guard is not None:
            self.refused = self._guard.judge(self.plant.set_point, self._previous, moved)
            self._previous = moved if self.refused is None else [0.0] * self._size
            moved = self._previous
        self.plant.move(moved)
        return self.episode.advance(self.plant.q, self.plant.position, self._rng)

    def retarget(self, request: PoseSample) -> None:
        """Move the target of this episode to where a person wants it.

        Raises:
            Refused: it may not lie there.
        """
        self.episode.target = requested_target(request, self.task.description, self.episode.target)

    def hold(self) -> None:
        """Let one period pass without a displacement; the task does not count it."""
        self.plant.move([0.0] * self._size)
        self._rest()

    def _rest(self) -> None:
        self.refused, self._previous = None, [0.0] * self._size
