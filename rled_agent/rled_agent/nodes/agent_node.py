"""Node: answers every state with joint displacements, and says on ``safety_gate`` who acts and why."""

import math
import time
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.messages import encode
from rled_msgs_py.records import Actor, DeltaCommand, GateCode, Text
from rled_msgs_py.ros.callbacks import Ending, every, serve
from rled_msgs_py.ros.command_output import CommandOutput
from rled_msgs_py.ros.liveliness import watch_liveliness
from rled_msgs_py.ros.node import advertise, declare, run_node, spin, subscribe, subscribe_ticks
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import STATE_TOPICS, Tick
from rled_msgs_py.topics import (
    DIAGNOSTICS,
    HUMAN_JOINT_DELTA,
    JOINT_STATES,
    ROBOT_DESCRIPTION,
    SAFETY_GATE,
    TASK_DESCRIPTION,
    Topic,
)
from rled_sim.commands import displacement
from rled_sim.kinematics import Chain
from rled_sim.motion_guard import Guard
from std_srvs.srv import SetBool, Trigger

from rled_agent.deploy.arbiter import Arbiter, Outcome, Situation
from rled_agent.deploy.online_learning import Answered, OnlineLearning
from rled_agent.deploy.piloting import Pilot, Proposal, load_policies, observe
from rled_agent.nodes.agent_params import AgentParams
from rled_agent.nodes.agent_report import AgentReport, decision_of

POLL_PERIOD = 0.02
"""Seconds between two looks at a state that waits for a person."""
REPORT_PERIOD = 0.1
"""Seconds between two reports, when there is something to tell."""


class Waiting(NamedTuple):
    """A state that was not answered yet."""

    tick: Tick
    observation: NDArray[np.float64]
    proposal: Proposal
    received: float


class AgentNode(Node):
    """Drives the robot with a learned policy, one answer and one gate decision for each state.

    Subscribes: joint_states, ee_pose, target_pose, task_status, task_description, robot_description,
    human/joint_delta. Publishes: joint_delta, safety_gate, /diagnostics.
    Services: ~/enable, ~/estop, ~/learn (std_srvs/SetBool), ~/save (std_srvs/Trigger).
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("agent_node", **arguments)
        torch.set_num_threads(1)
        torch.set_flush_denormal(True)
        self._arbiter: Arbiter | None = None
        self._waiting: Waiting | None = None
        given = declare(self, AgentParams, self._on_change, self._require)
        policies = load_policies(given.expert, given.agent)
        self._trained = policies.agent.origin.gate if policies.agent is not None else None
        self._params = given.in_force(self._trained)
        self._pilot = Pilot(policies, self._params.strategy(self._trained), self._params.seed)
        self._show_in_force(given)
        if policies.is_gated:
            self.get_logger().info(given.gate_said(self._trained))
        self._task: TaskDescription | None = None
        self._urdf = ""
        self._enabled = self._params.enabled
        self._learning = OnlineLearning(
            self._pilot.policy, self._params.agent, self._params.learning_state, self._params.learning_priority
        )
        self._episode = -1
        self._answered: Answered | None = None
        self._told: tuple[int, GateCode] | None = None
        self._newest = -1
        self._reported = -math.inf
        self._report = AgentReport(self._pilot.policy.task.period * 1e-9)
        self._delta, self._gate = CommandOutput(self), advertise(self, SAFETY_GATE)
        self._diagnostics = advertise(self, DIAGNOSTICS)
        for topic, hear in (
            (TASK_DESCRIPTION, self._on_task),
            (ROBOT_DESCRIPTION, self._on_robot),
            (HUMAN_JOINT_DELTA, self._on_person),
        ):
            subscribe(self, topic, hear, partial(self._refuse, topic))
        subscribe_ticks(self, self._on_tick)
        self._life = watch_liveliness(self, TASK_DESCRIPTION, self._on_life)
        serve(self, SetBool, "~/enable", self._on_enable)
        serve(self, SetBool, "~/estop", self._on_estop)
        serve(self, SetBool, "~/learn", self._on_learn)
        serve(self, Trigger, "~/save", self._on_save)
        if self._params.learn:
            self._learning.start()
        every(self, 1.0, self._say_health)
        every(self, POLL_PERIOD, self._decide)
        report_waiting(self, self._awaited)

    def _awaited(self) -> str:
        missing = [
            *([TASK_DESCRIPTION.name] if self._task is None else []),
            *([ROBOT_DESCRIPTION.name] if not self._urdf else []),
            *([] if self._newest >= 0 else [topic.name for topic in STATE_TOPICS]),
        ]
        return waiting_for(self, "sim_node", ", ".join(missing)) if missing else ""

    def _require(self, given: AgentParams) -> None:
        self._pilot.require(given.in_force(self._trained).strategy(self._trained))

    def _on_change(self, given: AgentParams) -> None:
        params = given.in_force(self._trained)
        self._pilot.adjust(params.strategy(self._trained))
        if self._arbiter is not None:
            self._arbiter.settings = params.safety()
        self._params = params
        if self._waiting is not None:
            self._waiting = self._waiting._replace(proposal=self._pilot.propose(self._waiting.observation))
        self._show_in_force(given)

    def _show_in_force(self, given: AgentParams) -> None:
        """Let the node's parameters be the values that are used, in place of what stands for them."""
        if given.not_given:
            params = given.in_force(self._trained)
            self.set_parameters([Parameter(name, value=getattr(params, name)) for name in given.not_given])

    def _on_task(self, text: Text) -> None:
        task = TaskDescription.from_json(text.data)
        try:
            task.require_same_robot(self._pilot.policy.task, "the policy")
        except ContractError as error:
            if self._arbiter is None:
                raise Ending(RledError(error.what, error.accepted)) from None  # the policy of another robot
            raise
        self._arbitrate(task, self._urdf)

    def _on_robot(self, text: Text) -> None:
        self._arbitrate(self._task, text.data)

    def _arbitrate(self, task: TaskDescription | None, urdf: str) -> None:
        """Make the arbiter anew when the robot has described itself, wholly and well."""
        if task is not None and urdf:
            try:
                guard = Guard(task, Chain.from_urdf(urdf, task.tip_link, task.joint_names))
            except RledError as error:
                self._refuse(ROBOT_DESCRIPTION, error)
                return
            stopped = self._arbiter is not None and self._arbiter.stopped
            self._arbiter = Arbiter(self._params.safety(), guard, task.action_size)
            self._arbiter.stopped = stopped
        self._task, self._urdf = task, urdf
        self._decide()

    def _refuse(self, topic: Topic, error: RledError) -> None:
        self._report.refused(topic.name)
        self.get_logger().warning(f"{topic.name} refused: {error}", throttle_duration_sec=1.0)
        if time.monotonic() - self._reported > REPORT_PERIOD:
            self._say_health()

    def _on_life(self, simulation: bool) -> None:
        self._report.living(simulation)
        if simulation:
            self.get_logger().info("a simulation is there; " + _doing(self._enabled))
        else:
            self.get_logger().warning("the simulation is gone; waiting for it")
        self._say_health()

    def _on_tick(self, tick: Tick) -> None:
        received = time.monotonic()
        try:
            observation = observe(self._pilot.policy.task, tick)
        except RledError as error:
            self._refuse(JOINT_STATES, error)
            return
        self._newest = tick.stamp
        self._delta.withdraw()
        before, self._answered, self._waiting = self._answered, None, None
        if tick.status.episode != self._episode:
            self._episode = tick.status.episode
            self._pilot.begin()
        if not (tick.status.terminated or tick.status.truncated):
            self._waiting = Waiting(tick, observation, self._pilot.propose(observation), received)
            self._decide()
        self._learning.go_on(before, tick.status, observation)  # after the answer: to wake another process takes time

    def _on_person(self, command: DeltaCommand) -> None:
        if self._arbiter is None or self._task is None:
            return
        try:
            delta = np.array(displacement(command, self._task))
            self._require_fresh(command.stamp)
        except RledError as error:
            self._refuse(HUMAN_JOINT_DELTA, error)
            return
        self._arbiter.hear_person(delta, time.monotonic())
        self._decide()

    def _require_fresh(self, stamp: int) -> None:
        """A person answers about the newest state, which may have reached the person first."""
        slack = round(self._params.human_timeout * 1e9)
        if abs(stamp - self._newest) > slack:
            accepted = f"{self._newest - slack} to {self._newest + slack} ns"
            raise RledError(f"a command for the state of {stamp} ns", accepted)

    def _decide(self) -> None:
        """Answer the state that waits, unless it is a person's turn."""
        waiting, arbiter = self._waiting, self._arbiter
        if waiting is None or arbiter is None or not self._enabled:
            return
        now, names = time.monotonic(), self._pilot.policy.task.joint_names
        q = waiting.tick.joints.ordered(names).position
        outcome = arbiter.decide(Situation(now, now - waiting.received, q, waiting.proposal))
        if outcome is None:
            return
        if outcome.delta is not None:
            self._delta.publish(DeltaCommand(waiting.tick.stamp, names, outcome.delta))
            self._answered = Answered(waiting.tick.status, waiting.observation, outcome.delta, outcome.actor)
            self._waiting = None
            if outcome.actor is not Actor.HUMAN:
                self._report.answered(time.monotonic() - waiting.received)
        self._tell(waiting, outcome)

    def _tell(self, waiting: Waiting, outcome: Outcome) -> None:
        if self._told == (waiting.tick.stamp, outcome.code):
            return
        self._told = waiting.tick.stamp, outcome.code
        self._report.decided(outcome.code)
        self._gate.publish(encode(SAFETY_GATE, decision_of(waiting.tick, waiting.proposal, outcome)))

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._enabled = request.data
        self._decide()  # in lockstep the simulation still waits for this answer
        return _say(response, True, _doing(request.data))

    def _on_estop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self._arbiter is None:
            return _say(response, False, "no robot yet")
        self._arbiter.stopped = request.data
        self._decide()
        return _say(response, True, "stopped until released" if request.data else "released")

    def _on_learn(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        try:
            self._learning.switch(request.data)
        except RledError as error:
            return _say(response, False, str(error))
        return _say(response, True, "learning" if request.data else "not learning")

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            folder = self._learning.save()
        except (OSError, RledError) as error:
            return _say(response, False, str(error))
        return _say(response, True, f"saved into {folder}")

    def _say_health(self) -> None:
        self._reported = time.monotonic()
        now = self.get_clock().now().nanoseconds
        health = self._report.health(now, self._enabled, self._arbiter, self._learning.client)
        self._diagnostics.publish(encode(DIAGNOSTICS, health))

    def destroy_node(self) -> None:
        """End the learning process, which saves its state, with the node."""
        self._learning.close()
        super().destroy_node()


def _doing(enabled: bool) -> str:
    return "answers states" if enabled else "silent: the robot holds"


def _say(response: Any, success: bool, message: str) -> Any:
    response.success, response.message = success, message
    return response


def main() -> None:
    """Run the node."""
    summary = "Drive the robot with a learned policy, one decision per state."
    run_node(
        AgentNode, AgentParams, "agent_node", summary,
        lambda node, stop: spin(node, stop, EventsExecutor(context=node.context)),
    )  # fmt: skip


if __name__ == "__main__":
    main()
