"""The Gymnasium environments with faults on purpose."""

from typing import Any

import gymnasium
import numpy as np
from rled_msgs_py.errors import RledError

from rled_sim.action import action_array
from rled_sim.envs import Floats, ReachEnv
from rled_sim.fault_channel import FaultChannel
from rled_sim.faults import NO_FAULTS, Faults, require_faults
from rled_sim.robots import robot_named
from rled_sim.ticks import tick_of


class FaultyReach(gymnasium.Wrapper[Floats, Floats, Floats, Floats]):
    """One of this project's environments behind a fault channel.

    With the same seed it gives the transitions that ``sim_node`` with the same faults gives over the topics, bit for
    bit. Ends and counts are those of the step; states and rewards may be older, see ``rled_sim.faults``.
    """

    def __init__(self, env: gymnasium.Env[Floats, Floats], faults: Faults) -> None:
        """Put a channel before an environment.

        Args:
            env: one of this project's.
            faults: of the channel.

        Raises:
            RledError: another environment, or something to hide that there is not.
        """
        super().__init__(env)
        if not isinstance(env.unwrapped, ReachEnv):
            raise RledError(f"faults of {env}", "one of this project's environments")
        self._reach: ReachEnv = env.unwrapped
        self._task = self._reach.task
        self._channel = FaultChannel(faults, self._task, robot_named(self._task.robot).chain.position)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; a seed begins the faults anew too."""
        _, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._channel.seed(seed)
        self._channel.begin()
        return self._seen(0.0)[0], info

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Send ``action`` (rad), shape (n,), and take what arrives; where none does, the robot stays."""
        largest = self._task.max_delta
        sent = np.clip(action_array(action, self._task.action_size), -largest, largest)
        arrived = self._channel.act(sent.tolist()) or np.zeros_like(sent)
        _, reward, terminated, truncated, info = self.env.step(np.asarray(arrived))
        observation, paid = self._seen(float(reward))
        return observation, paid, terminated, truncated, info

    def _seen(self, reward: float) -> tuple[Floats, float]:
        tick = self._channel.see(tick_of(self._reach.simulation, 0, 0, reward))
        observation = self._task.observe(tick.joints.position, tick.ee.position, tick.target.position)
        return observation.astype(np.float32), tick.status.reward


def make_reach(*, faults: Faults = NO_FAULTS, **options: Any) -> gymnasium.Env[Floats, Floats]:
    """``ReachEnv``, behind a fault channel if there are faults."""
    require_faults(faults)
    env = ReachEnv(**options)
    try:
        return FaultyReach(env, faults) if faults.any else env
    except BaseException:
        env.close()
        raise


make_reach.metadata = ReachEnv.metadata  # type: ignore[attr-defined]  # where gymnasium.make looks for it
