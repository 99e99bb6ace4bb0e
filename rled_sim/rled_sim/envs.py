"""Gymnasium environments: a thin view of the simulation."""

import time
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import Reward
from rled_msgs_py.task_limits import NO_LIMITS, Limits

from rled_sim.action import action_array, refuse_options
from rled_sim.bullet.client import has_display
from rled_sim.bullet.world import Transition, World
from rled_sim.robots import robot_named
from rled_sim.simulation import Simulation
from rled_sim.spaces import action_space, observation_space
from rled_sim.tasks import reach_task

Floats = NDArray[np.float32]


class ReachEnv(gymnasium.Env[Floats, Floats]):
    """A robot reaching targets, see ``rled_sim.tasks``.

    Action: joint displacements Δq (rad), shape (n,), within ±Δq_max. Observation: ``TaskDescription.observe``. ``info``
    has ``targets_reached``, ``violations`` and ``risky``, with motors ``contacts``, the pairs that touch, and where a
    limit forbade the action ``refused``, its name: the robot stayed where it was, and the step counts.

    ``copy.deepcopy`` and ``pickle`` give an environment with a world of its own in the same state, as a tree search
    wants it: with motors that touch something the two agree within rounding, else bit for bit. One with a window
    refuses. An environment that nobody holds any more is closed.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human", "rgb_array"], "render_fps": 50}

    def __init__(
        self,
        robot: str,
        *,
        reward: Reward = "dense",
        start_joints: ArrayLike | None = None,
        transition: Transition = "kinematic",
        targets_per_episode: int | None = None,
        max_steps: int | None = None,
        limits: Limits = NO_LIMITS,
        target_spread: float = 0.0,
        render_mode: str | None = None,
    ) -> None:
        """Open the environment.

        Args:
            robot: name of the robot.
            reward: ``dense`` or ``sparse``.
            start_joints: joint angles that episodes start at (rad), shape (k, n); the robot's home when None.
            transition: ``kinematic`` (Eq. 4.28) or ``motors`` (physics).
            targets_per_episode: targets that end an episode, 0 never; the task's own when None.
            max_steps: steps that cut an episode, 0 never; the task's own when None.
            limits: what motion has to keep within besides Δq_max.
            target_spread: how far beside the curve a target lies at most, along each axis of the task (m).
            render_mode: ``human`` for PyBullet's window, ``rgb_array`` for pictures.

        Raises:
            RledError: unknown robot, start joints or limits that do not fit it, or a spread that is no length.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise RledError(f"render_mode '{render_mode}'", ", ".join(self.metadata["render_modes"]))
        self.render_mode = render_mode
        gui = render_mode == "human" and has_display()
        if render_mode == "human" and not gui:
            gymnasium.logger.warn("render_mode 'human' shows nothing: no X display in DISPLAY")
        chosen = robot_named(robot)
        task = reach_task(
            chosen,
            reward=reward,
            targets_per_episode=targets_per_episode,
            max_steps=max_steps,
            limits=limits,
            target_spread=target_spread,
        )
        self.task = task.description
        self._period = self.task.period * 1e-9
        self._world = World(chosen, transition, self._period, gui)
        try:
            self.simulation = Simulation(self._world, task, start_joints)
        except BaseException:
            self._world.close()
            raise
        self._axes, self._relative = self.task.axes, self.task.observation == "displacement_and_joints"
        self.observation_space, self.action_space = observation_space(self.task), action_space(self.task)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; a seed begins the random draws anew.

        Raises:
            RledError: the environment is closed, or an option is asked for; there is none.
        """
        self._world.require_open()
        refuse_options(options)
        super().reset(seed=seed)
        self.simulation.reset(self.np_random)
        self._show()
        return self._observation(), self._info()

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Displace the joints by ``action`` (rad), shape (n,).

        Raises:
            RledError: the environment is closed or was not reset, or the action is not n finite numbers.
        """
        self._world.require_open()
        delta = action_array(action, self.task.action_size).tolist()
        reward, terminated, truncated = self.simulation.step(delta)
        if self.render_mode == "human":
            self._show()
        return self._observation(), reward, terminated, truncated, self._info()

    def render(self) -> NDArray[np.uint8] | None:
        """A picture, shape (480, 640, 3); nothing in the mode ``human``, whose window is always up to date."""
        if self.render_mode != "rgb_array":
            return None
        self._world.require_open()
        self._world.show_target(self.simulation.episode.target)
        return self._world.picture()

    def close(self) -> None:
        """Close the world."""
        self._world.close()

    def _observation(self) -> Floats:
        # TaskDescription.observe with plain numbers: the same bits (a test), without numpy's cost per call.
        world, target = self._world, self.simulation.episode.target
        tip = world.position
        if self._relative:
            return np.array([target[axis] - tip[axis] for axis in self._axes] + world.q, np.float32)
        return np.array([point[axis] for point in (tip, target) for axis in self._axes], np.float32)

    def _info(self) -> dict[str, Any]:
        episode = self.simulation.episode
        info: dict[str, Any] = {
            "targets_reached": episode.targets_reached,
            "violations": episode.violations,
            "risky": episode.risky,
        }
        if self._world.physical:
            info["contacts"] = self._world.contacts()
        if self.simulation.refused is not None:
            info["refused"] = self.simulation.refused.name
        return info

    def _show(self) -> None:
        if self.render_mode == "human":
            self._world.show_target(self.simulation.episode.target)
            time.sleep(self._period)
