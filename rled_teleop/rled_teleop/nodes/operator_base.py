"""What every operator node does: learn robot and task from the topics, answer each new tick at its pace."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.params import param
from rled_msgs_py.records import DeltaCommand, Text
from rled_msgs_py.ros.callbacks import every
from rled_msgs_py.ros.command_output import CommandOutput
from rled_msgs_py.ros.liveliness import has_deadline
from rled_msgs_py.ros.node import subscribe, subscribe_ticks
from rled_msgs_py.ros.waiting import waiting_for
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import HUMAN_JOINT_DELTA, JOINT_DELTA, JOINT_STATES, ROBOT_DESCRIPTION, TASK_DESCRIPTION
from rled_sim.kinematics import Chain

from rled_teleop.operators.jog import Jog

Vector = NDArray[np.float64]
Steer = Callable[[Jog, Vector], Vector | None]
"""Makes Δq (rad) of joint angles (rad), both of shape (n,); None when the person has let go."""

POLL_PERIOD = 0.005
"""Seconds between two polls of keys, devices and ticks that wait."""
ROBOT_TIMEOUT = 1.0
"""Seconds without a tick after which another robot may take the place of the one that was driven."""
SLACK = 0.5
"""Share of a period that ticks of a real-time simulation may come early or late without being waited for."""


@dataclass(frozen=True)
class OperatorBaseParams:
    """Parameters of every operator that a person drives with."""

    timeout: float = param(
        0.3, "deadman: motion ends so long after the last key or message (s)", low=0.02, high=2.0, read_only=True
    )
    beside_agent: bool = param(
        False,
        "publish human/joint_delta, and only while moving, to take over from an agent",
        read_only=True,
    )


class OperatorBase:
    """Answers ticks with a displacement; zero when the person has let go.

    In lockstep the simulation waits for the answer, so this keeps real time for both of them: one answer each period.
    A simulation that promises states at a pace of its own is answered at once.

    Args:
        node: whose topics and timer are used.
        beside_agent: publish on ``human/joint_delta`` and nothing when the person has let go.
        steer: what the person wants.
        watch: called with each tick, whether it is answered or not.
        meet: called with task and URDF of the robot when it has described itself.

    Attributes:
        jog: the robot, None until it has described itself.
        tick: the newest one, in the order of the robot's joints once ``jog`` is there; None before the first.
        delta: the newest answer (rad), shape (n,); None before the first.
    """

    def __init__(
        self,
        node: Node,
        beside_agent: bool,
        steer: Steer,
        watch: Callable[[Tick], None] = lambda tick: None,
        meet: Callable[[TaskDescription, str], None] = lambda task, urdf: None,
    ) -> None:
        self._node, self._beside_agent, self._steer, self._watch, self._meet = node, beside_agent, steer, watch, meet
        self._task: TaskDescription | None = None
        self._urdf = ""
        self.jog: Jog | None = None
        self.tick: Tick | None = None
        self.delta: Vector | None = None
        self._is_answered, self._due, self._heard = True, -np.inf, -np.inf
        self._has_clock: bool | None = None
        self._outputs: dict[bool, CommandOutput] = {}
        self._output = self._output_for(beside_agent)
        subscribe(node, TASK_DESCRIPTION, self._on_task)
        subscribe(node, ROBOT_DESCRIPTION, self._on_robot)
        subscribe_ticks(node, self._on_tick)

    @property
    def beside_agent(self) -> bool:
        """Whether somebody else answers, and this only takes over."""
        return self._beside_agent

    def awaited(self) -> str:
        """What is waited for before anything can move; empty when nothing is."""
        if self.jog is None:
            return waiting_for(self._node, "sim_node", f"{TASK_DESCRIPTION.name} and {ROBOT_DESCRIPTION.name}")
        return waiting_for(self._node, "sim_node", JOINT_STATES.name) if self.tick is None else ""

    def stand(self, beside_agent: bool) -> None:
        """Answer alone from now on, or stand beside an agent; the other topic's publisher stays, and is silent."""
        if beside_agent != self._beside_agent:
            self._beside_agent = beside_agent
            self._output.withdraw()
            self._output = self._output_for(beside_agent)
            self._is_answered = False  # in lockstep the simulation may wait for it

    def _output_for(self, beside_agent: bool) -> CommandOutput:
        """Made once and never destroyed: the events executor crashes when the event of a destroyed one is pending."""
        if beside_agent not in self._outputs:
            topic = HUMAN_JOINT_DELTA if beside_agent else JOINT_DELTA
            self._outputs[beside_agent] = CommandOutput(self._node, topic)
        return self._outputs[beside_agent]

    def poll(self) -> None:
        """Answer the newest tick if it is time; call it every ``POLL_PERIOD``."""
        if self.jog is None or self.tick is None or self._is_answered:
            return
        now = time.monotonic()
        period = self.jog.task.period * 1e-9
        if self._has_clock or now >= self._due:
            self._due = max(self._due, now - SLACK * period) + period
            self._answer(self.jog, self.tick)

    def start_timer(self, poll: Callable[[], None]) -> None:
        """Call ``poll`` by the wall clock."""
        every(self._node, POLL_PERIOD, poll)

    def _answer(self, jog: Jog, tick: Tick) -> None:
        self._is_answered = True
        if tick.status.terminated or tick.status.truncated:
            return
        names = jog.task.joint_names
        delta = self._steer(jog, tick.joints.position)
        if delta is not None and not np.isfinite(delta).all():  # of a state or a device that cannot be
            delta = None
        self.delta = np.zeros(len(names)) if delta is None else delta
        if delta is not None or not self._beside_agent:
            self._output.publish(DeltaCommand(tick.stamp, names, self.delta))

    def _on_tick(self, tick: Tick) -> None:
        if self._has_clock is None or (self.tick is not None and tick.stamp < self.tick.stamp):
            self._has_clock = has_deadline(self._node, JOINT_STATES)
        self.tick, self._is_answered = tick if self.jog is None else tick.ordered(self.jog.task.joint_names), False
        self._heard = time.monotonic()
        self._output.withdraw()
        self._watch(self.tick)
        self.poll()

    def _on_task(self, text: Text) -> None:
        task = TaskDescription.from_json(text.data)
        if self.jog is not None and time.monotonic() < self._heard + ROBOT_TIMEOUT:
            self.jog.task.require_same_robot(task, "the new description")
        self._describe(task, self._urdf)

    def _on_robot(self, text: Text) -> None:
        self._describe(self._task, text.data)

    def _describe(self, task: TaskDescription | None, urdf: str) -> None:
        """Take the newest description; one that does not fit changes nothing once there is a robot."""
        if self.jog is None:
            self._task, self._urdf = task, urdf
        if task is None or not urdf:
            return
        try:
            jog = Jog(task, Chain.from_urdf(urdf, task.tip_link, task.joint_names))
        except RledError as error:
            self._node.get_logger().error(str(error), throttle_duration_sec=1.0)
            return
        self._task, self._urdf = task, urdf
        self._drive(jog)
        self._meet(task, urdf)

    def _drive(self, jog: Jog) -> None:
        self.jog, self._due = jog, -np.inf
        try:
            self.tick = self.tick and self.tick.ordered(jog.task.joint_names)
        except ContractError:  # it is of the robot before
            self.tick = None
