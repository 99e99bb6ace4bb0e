"""Gymnasium's view of a batch."""

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from rled_msgs_py.errors import RledError
from rled_msgs_py.task_limits import NO_LIMITS, Limits

from rled_sim.action import refuse_options
from rled_sim.spaces import action_space, observation_space
from rled_sim.vector.arrays import Array
from rled_sim.vector.reach import ReachBatch

INFO = ("targets_reached", "violations", "risky")


class ReachVectorEnv(gymnasium.vector.VectorEnv[Array, Array, Array]):
    """``ReachBatch`` as ``gymnasium.make_vec`` gives it: equal to a ``SyncVectorEnv`` of ``ReachEnv``, and faster.

    An episode that is over is followed by the next one in the next step, which ignores the action and has reward 0.
    Observations, rewards, ends and ``info`` are numpy arrays; with a device, tensors on it.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int,
        robot: str,
        *,
        transition: str = "kinematic",
        limits: Limits = NO_LIMITS,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Open the environments.

        Args:
            num_envs: how many.
            robot: name of the robots.
            transition: ``kinematic``; nothing else is stepped as a batch.
            limits: none; they are not judged as a batch.
            render_mode: None; there are no pictures of a batch.
            options: of ``ReachBatch``.

        Raises:
            RledError: what only single environments do, or settings that do not fit.
        """
        _require("transition", transition, "kinematic")
        _require("limits", limits, NO_LIMITS)
        _require("render_mode", render_mode, None)
        self.batch, self.num_envs = ReachBatch(robot, num_envs, **options), num_envs
        self.single_observation_space = observation_space(self.batch.task)
        self.single_action_space = action_space(self.batch.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._all = self.batch.episodes.steps == 0
        self._over = self._all  # what has not begun begins with the next step

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode in each environment.

        Args:
            seed: begins the draws anew: of a number, with one more for each environment after the first.
            options: ``reset_mask``, shape (N,): only where it holds an episode and its draws begin.

        Raises:
            RledError: seeds, a mask or options that there are not.
        """
        others = dict(options or {})
        which = self.batch.mask(others.pop("reset_mask", self._all))
        refuse_options(others)
        if seed is not None:
            self.batch.seed(self._seeds(seed, which.tolist()))
        observation = self.batch.begin(which)
        self._over = self._over & ~which
        return observation, self._info(which)

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Displace the joints by ``actions`` (rad), shape (N, n), or begin the next episode where one is over.

        Raises:
            RledError: the environments were not reset, or actions of another shape.
        """
        is_idle = isinstance(self._over, np.ndarray) and not self._over.any()  # a device is not asked, which would wait
        step = self.batch.step(actions, None if is_idle else self._over)
        self._over = step.terminated | step.truncated
        return step.observation, step.reward, step.terminated, step.truncated, self._info(self._all)

    def _seeds(self, seed: int | Sequence[int | None], which: list[bool]) -> list[int | None]:
        """The seed of each environment where ``which`` holds, None elsewhere."""
        seeds = [seed + row for row in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        if len(seeds) != self.num_envs:
            raise RledError(f"{len(seeds)} seeds", f"{self.num_envs}, one for each environment")
        return [each if chosen else None for each, chosen in zip(seeds, which, strict=True)]

    def _info(self, which: Array) -> dict[str, Any]:
        """What ``ReachEnv`` tells, and a mask of the environments that it is told of."""
        told = {name: getattr(self.batch.episodes, name) * which for name in INFO}
        return told | {f"_{name}": which for name in INFO}


def _require(name: str, given: object, accepted: object) -> None:
    if given != accepted:
        raise RledError(
            f"{name} {given!r} of a batch",
            repr(accepted),
            "use gymnasium.make, or make_vec with vectorization_mode='sync'",
        )
