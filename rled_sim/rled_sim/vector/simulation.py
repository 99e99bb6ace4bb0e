"""How N episodes begin and go on: what ``Simulation`` and ``Episode`` do of one, with arrays."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rled_sim.draws import offset
from rled_sim.robots import Robot
from rled_sim.starts import start_points
from rled_sim.tasks import ReachTask
from rled_sim.vector.arrays import Array, Arrays
from rled_sim.vector.draws import Draws


class Episodes(NamedTuple):
    """How far episodes have come.

    Attributes:
        joints: joint angles (rad), shape (N, n).
        position: end effector (m), shape (N, 3).
        target: point to reach (m), shape (N, 3).
        steps: transitions so far, shape (N,).
        targets_reached: targets reached, shape (N,).
        violations: risky states so far, the first included, shape (N,).
        risky: the present state is risky, shape (N,).
    """

    joints: Array
    position: Array
    target: Array
    steps: Array
    targets_reached: Array
    violations: Array
    risky: Array


class Outcomes(NamedTuple):
    """What the task says of transitions, each of shape (N,)."""

    reward: Array
    terminated: Array
    truncated: Array


class BatchSimulation:
    """Begins and steps episodes of kinematic robots.

    Attributes:
        draws: the uniforms of starts and targets.
    """

    def __init__(
        self, arrays: Arrays, num_envs: int, robot: Robot, task: ReachTask, start_joints: ArrayLike | None
    ) -> None:
        """Prepare the robot's and the task's numbers.

        Args:
            arrays: where they lie.
            num_envs: N.
            robot: of all environments.
            task: its task.
            start_joints: joint angles that episodes start at (rad), shape (k, n); the robot's home when None.

        Raises:
            RledError: start joints of another shape, or outside the joint limits.
        """
        self._arrays, self._task, self._chain = arrays, task, robot.chain
        starts = [list(robot.home)] if start_joints is None else start_points(start_joints, task.description)
        numbers = (starts, task.targets, robot.lower, robot.upper)
        self._starts, self._targets, self._lower, self._upper = map(arrays.array, numbers)
        self._start_positions = self._chain.position(self._starts)
        self._start_risks = task.risky(self._starts.T, self._start_positions.T)
        self.draws = Draws(arrays, num_envs, 1 + 2 * task.target_draws)

    def nothing(self, num_envs: int) -> Episodes:
        """Environments in which no episode has begun: their places are NaN."""
        zero = self._arrays.full((num_envs,), 0, "int64")
        joints, point = (self._arrays.full((num_envs, size), np.nan) for size in (self._lower.shape[0], 3))
        return Episodes(joints, point, point, zero, zero, zero, zero > 0)

    def begun(self, before: Episodes, which: Array) -> Episodes:
        """Episodes begin where ``which`` holds: a start is drawn, then a target."""
        uniforms = self.draws.take(which, 1 + self._task.target_draws)
        start, zero = self._index(uniforms[:, 0], len(self._starts)), before.steps * 0
        joints, position, risky = (each[start] for each in (self._starts, self._start_positions, self._start_risks))
        new = Episodes(joints, position, self._target(uniforms[:, 1:]), zero, zero, zero + risky, risky)
        return Episodes(*(self._arrays.chosen(which, *each) for each in zip(new, before, strict=True)))

    def stepped(self, before: Episodes, delta: Array, which: Array) -> tuple[Episodes, Outcomes]:
        """All joints are displaced by ``delta`` (rad), shape (N, n), clipped; see ``Episode.advance``.

        Where ``which`` does not hold no target is drawn, and what comes of it means nothing.
        """
        xp, task = self._arrays.xp, self._task.description
        delta = xp.clip(delta, -task.max_delta, task.max_delta)
        joints = xp.clip(before.joints + delta, self._lower, self._upper)
        position = self._chain.position(joints)
        reward, reached, risky = self._task.judge(joints, position, before.target)
        steps, targets_reached = before.steps + 1, before.targets_reached + reached
        terminated = reached & (targets_reached == task.targets_per_episode)
        truncated = ~terminated & (steps == task.max_steps)
        target = self._next_target(before.target, reached & ~terminated, which)
        after = Episodes(joints, position, target, steps, targets_reached, before.violations + risky, risky)
        return after, Outcomes(reward, terminated, truncated)

    def observation(self, of: Episodes) -> Array:
        """``TaskDescription.observe``, shape (N, o), float32."""
        return self._arrays.cast(self._task.description.observe(of.joints, of.position, of.target), "float32")

    def _next_target(self, target: Array, replaced: Array, which: Array) -> Array:
        drawn = self._target(self.draws.take(replaced & which, self._task.target_draws))
        return self._arrays.chosen(replaced, drawn, target)

    def _target(self, uniforms: Array) -> Array:
        """``ReachTask.draw_target`` of uniforms: (N, target_draws) -> (N, 3)."""
        points = self._targets[self._index(uniforms[:, 0], len(self._targets))]
        if self._task.target_spread:
            for column, axis in enumerate(self._task.description.axes, 1):
                points[:, axis] += offset(uniforms[:, column], self._task.target_spread)
        return points

    def _index(self, uniforms: Array, count: int) -> Array:
        return self._arrays.cast(uniforms * count, "int64")
