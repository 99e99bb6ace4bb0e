"""A Gymnasium environment over the topics of a running graph.

Any Gymnasium learner trains over ROS 2 with it. In lockstep, an episode begun with a seed gives the transitions of the
environment in process with that seed, bit for bit.
"""

import time
import weakref
from collections import deque
from typing import Any, NoReturn

import gymnasium
import numpy as np
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.debounce import WaitingReport
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import DeltaCommand, Text
from rled_msgs_py.ros.command_output import CommandOutput
from rled_msgs_py.ros.node import fresh_context, subscribe, subscribe_ticks
from rled_msgs_py.ros.waiting import waiting_for
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import TASK_DESCRIPTION
from rled_msgs_py.validation import MAX_INT
from rled_sim.action import action_array, refuse_options

from rled_agent.nodes.restart import Restart

Floats = NDArray[np.float32]
REMEDY = "is sim_node running, in this ROS_DOMAIN_ID, with --mode lockstep?"


class _Graph:
    """A node of its own on the graph, and what it has heard; nothing in it refers to the environment that uses it."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self._context = fresh_context()
        self.node = Node("graph_env", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.ticks: deque[Tick] = deque()
        self.tasks: list[TaskDescription] = []
        subscribe(self.node, TASK_DESCRIPTION, self._on_task)
        subscribe_ticks(self.node, self.ticks.append)

    def _on_task(self, text: Text) -> None:
        self.tasks.append(TaskDescription.from_json(text.data))

    def require_open(self) -> None:
        """Refuse what needs the graph.

        Raises:
            RledError: it was left.
        """
        if not self._context.ok():
            raise RledError("the environment is closed", "an open one", "make it again")

    def wait(self, done: Any, what: str) -> None:
        """Spin until a predicate holds.

        Raises:
            RledError: it does not within the timeout, or the environment is closed.
        """
        self.require_open()
        deadline, waiting = time.monotonic() + self.timeout, WaitingReport()
        while not done():
            if (now := time.monotonic()) > deadline:
                raise RledError(f"waited {self.timeout:g} s for {what}", "", REMEDY)
            if waiting.is_due(what, now):
                self.node.get_logger().info(f"waiting for {waiting_for(self.node, 'sim_node', what)}")
            self._executor.spin_once(timeout_sec=0.1)

    def leave(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


class GraphEnv(gymnasium.Env[Floats, Floats]):
    """Steps a robot on the graph: an action is a ``joint_delta``, an observation the tick that answers it.

    Spaces and ``info`` are those of this project's environments in process; they come from ``task_description``. One
    that nobody holds any more leaves the graph. There is one robot on the other side, so none is copied or pickled.

    Args:
        simulation: name of the simulation node.
        timeout: seconds to wait for any answer.

    Raises:
        RledError: no simulation on the graph.
    """

    def __init__(self, simulation: str = "sim", timeout: float = 10.0) -> None:
        self._graph = _Graph(timeout)
        self._leave = weakref.finalize(self, self._graph.leave)
        try:
            self._delta = CommandOutput(self._graph.node)
            self._restart = Restart(self._graph.node, self._graph.wait, simulation)
            publisher, tasks = self._delta.publisher, self._graph.tasks
            self._graph.wait(lambda: bool(tasks) and publisher.get_subscription_count() > 0, "a simulation")
        except BaseException:
            self.close()
            raise
        self.task = tasks[0]
        self._tick: Tick | None = None
        self._begun = False
        lower, upper = self.task.observation_bounds()
        self.observation_space = gymnasium.spaces.Box(lower.astype(np.float32), upper.astype(np.float32))
        most = self.task.max_delta
        self.action_space = gymnasium.spaces.Box(-most, most, (self.task.action_size,), np.float32)

    @property
    def is_repeatable(self) -> bool:
        """Whether the same seed and actions give the same episode again, as of a simulation in lockstep.

        Raises:
            RledError: no answer.
        """
        return self._restart.is_repeatable()

    def __reduce_ex__(self, _: Any) -> NoReturn:
        """Refuse a copy.

        Raises:
            RledError: always.
        """
        remedy = "copy an environment in process, or make a GraphEnv for a second simulation"
        raise RledError("an environment over the graph is not copied or pickled: its robot is one", "", remedy)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; a seed begins the simulation's random draws anew.

        Raises:
            RledError: an option, a seed that the simulation does not take, or no answer of it.
        """
        refuse_options(options)
        super().reset(seed=seed)
        if seed is not None and seed >= MAX_INT:
            raise RledError(f"seed {seed}", f"0 to {MAX_INT - 1} over the graph")
        begins = self._restart.begin(seed)
        tick = self._next(lambda tick: tick.stamp >= begins)
        return self._seen(tick)

    def begin(self, action: Floats) -> None:
        """Send the action of the next ``step`` now: the robot moves while the caller does something else.

        Raises:
            RledError: the action is not n finite numbers, or no episode has begun.
        """
        most = self.task.max_delta
        delta = np.clip(action_array(action, self.task.action_size), -most, most)  # as the environments in process do
        self._delta.publish(DeltaCommand(self._answered().stamp, self.task.joint_names, delta))
        self._begun = True

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Displace the joints by ``action`` (rad), shape (n,), and wait for the tick that answers."""
        if not self._begun:
            self.begin(action)
        self._begun, answered = False, self._answered().stamp
        tick = self._next(lambda tick: tick.stamp > answered)
        observation, info = self._seen(tick)
        status = tick.status
        return observation, status.reward, status.terminated, status.truncated, info

    def close(self) -> None:
        """Leave the graph; a second call does nothing."""
        self._leave()

    def _answered(self) -> Tick:
        """The tick that the next action answers."""
        self._graph.require_open()
        if self._tick is None:
            raise RledError("no episode has begun", "", "call reset first")
        return self._tick

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
            self._graph.wait(lambda: bool(self._graph.ticks), "a tick")
            tick = self._graph.ticks.popleft()
            if wanted(tick):
                return tick
