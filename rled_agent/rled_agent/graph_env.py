"""A Gymnasium environment over the topics of a running graph.

Any Gymnasium learner trains over ROS 2 with it. In lockstep, an episode begun with a seed gives the transitions of the
environment in process with that seed, bit for bit.
"""

import time
from collections import deque
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.awaiting import brought_by
from rled_msgs_py.command_output import CommandOutput
from rled_msgs_py.errors import RledError
from rled_msgs_py.lasting import Waiting
from rled_msgs_py.node import fresh_context, subscribe, subscribe_ticks
from rled_msgs_py.records import DeltaCommand, Text
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import TASK_DESCRIPTION

from rled_agent.restart import Restart

Floats = NDArray[np.float32]
REMEDY = "is sim_node running, in this ROS_DOMAIN_ID, with --mode lockstep?"


class GraphEnv(gymnasium.Env[Floats, Floats]):
    """Steps a robot on the graph: an action is a ``joint_delta``, an observation the tick that answers it.

    Spaces and ``info`` are those of this project's environments in process; they come from ``task_description``.

    Args:
        simulation: name of the simulation node.
        timeout: seconds to wait for any answer.

    Raises:
        RledError: no simulation on the graph.
    """

    def __init__(self, simulation: str = "sim", timeout: float = 10.0) -> None:
        self._timeout = timeout
        self._context = fresh_context()
        self._node = Node("graph_env", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._ticks: deque[Tick] = deque()
        self._tasks: list[TaskDescription] = []
        subscribe(self._node, TASK_DESCRIPTION, self._on_task)
        subscribe_ticks(self._node, self._ticks.append)
        self._delta = CommandOutput(self._node)
        self._restart = Restart(self._node, self._wait, simulation)
        try:
            self._wait(lambda: bool(self._tasks) and self._delta.publisher.get_subscription_count() > 0, "a simulation")
        except RledError:
            self.close()
            raise
        self.task = self._tasks[0]
        lower, upper = self.task.observation_bounds()
        self.observation_space = gymnasium.spaces.Box(lower.astype(np.float32), upper.astype(np.float32))
        most = self.task.max_delta
        self.action_space = gymnasium.spaces.Box(-most, most, (self.task.action_size,), np.float32)

    def _on_task(self, text: Text) -> None:
        self._tasks.append(TaskDescription.from_json(text.data))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; a seed begins the simulation's random draws anew."""
        super().reset(seed=seed)
        begins = self._restart.begin(seed)
        tick = self._next(lambda tick: tick.stamp >= begins)
        return self._seen(tick)

    def begin(self, action: Floats) -> None:
        """Send the action of the next ``step`` now: the robot moves while the caller does something else."""
        most = self.task.max_delta
        delta = np.clip(np.asarray(action, dtype=np.float64), -most, most)  # as the environments in process do
        self._delta.publish(DeltaCommand(self._tick.stamp, self.task.joint_names, delta))
        self._begun = True

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Displace the joints by ``action`` (rad), shape (n,), and wait for the tick that answers."""
        if not self._begun:
            self.begin(action)
        self._begun, answered = False, self._tick.stamp
        observation, info = self._seen(self._next(lambda tick: tick.stamp > answered))
        status = self._tick.status
        return observation, status.reward, status.terminated, status.truncated, info

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _seen(self, tick: Tick) -> tuple[Floats, dict[str, Any]]:
        self._tick, self._begun = tick, False
        q = tick.joints.ordered(self.task.joint_names).position
        observation = self.task.observe(q, tick.ee.position, tick.target.position).astype(np.float32)
        status = tick.status
        info: dict[str, Any] = {
            "targets_reached": status.targets_reached,
            "violations": status.violations,
            "risky": status.risky,
        }
        if status.refused:
            info["refused"] = status.refused
        return observation, info

    def _next(self, wanted: Any) -> Tick:
        """The oldest tick not yet seen that is wanted; older ones are dropped."""
        while True:
            self._wait(lambda: bool(self._ticks), "a tick")
            tick = self._ticks.popleft()
            if wanted(tick):
                return tick

    def _wait(self, done: Any, what: str) -> None:
        deadline, waiting = time.monotonic() + self._timeout, Waiting()
        while not done():
            if (now := time.monotonic()) > deadline:
                raise RledError(f"waited {self._timeout:g} s for {what}", "", REMEDY)
            if waiting.is_due(what, now):
                self._node.get_logger().info(f"waiting for {brought_by(self._node, 'sim_node', what)}")
            self._executor.spin_once(timeout_sec=0.1)
