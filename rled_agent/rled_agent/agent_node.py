"""Node: answers every state with joint displacements, and says on ``safety_gate`` who acts and why."""

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rclpy.node import Node
from rled_msgs_py.convert import to_msg
from rled_msgs_py.node import advertise, declare, run_node, subscribe, subscribe_ticks
from rled_msgs_py.params import param
from rled_msgs_py.records import Actor, DeltaCommand, GateDecision, Health, Level, Text
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import DIAGNOSTICS, JOINT_DELTA, SAFETY_GATE, TASK_DESCRIPTION
from std_srvs.srv import SetBool

from rled_agent.policy import load_policy


@dataclass(frozen=True)
class AgentParams:
    """Parameters of the agent node."""

    expert: str = param("out/expert/expert.safetensors", "weights that train_expert wrote", read_only=True)
    enabled: bool = param(True, "answer states; ~/enable switches it")


class AgentNode(Node):
    """Drives the robot with a learned policy, one answer and one gate decision for each state.

    Subscribes: joint_states, ee_pose, target_pose, task_status, task_description.
    Publishes: joint_delta, safety_gate, /diagnostics.
    Services: ~/enable (std_srvs/SetBool).
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("agent_node", **arguments)
        torch.set_num_threads(1)
        params = declare(self, AgentParams)
        self._policy = load_policy(Path(params.expert))
        self._task: TaskDescription | None = None
        self._enabled = params.enabled
        self._answers, self._slowest = 0, 0.0
        self._delta, self._gate = advertise(self, JOINT_DELTA), advertise(self, SAFETY_GATE)
        self._diagnostics = advertise(self, DIAGNOSTICS)
        subscribe(self, TASK_DESCRIPTION, self._on_task)
        subscribe_ticks(self, self._on_tick)
        self.create_service(SetBool, "~/enable", self._on_enable)
        self.create_timer(1.0, self._report)

    def _on_task(self, text: Text) -> None:
        task = TaskDescription.from_json(text.data)
        task.require_same_robot(self._policy.task, "the policy")
        self._task = task

    def _on_tick(self, tick: Tick) -> None:
        over = tick.status.terminated or tick.status.truncated
        if self._enabled and not over:
            self._answer(tick)

    def _answer(self, tick: Tick) -> None:
        started = time.perf_counter()
        task = self._policy.task
        q = tick.joints.ordered(task.joint_names).position
        action = self._policy.act(task.observe(q, tick.ee.position, tick.target.position))
        delta = np.clip(action, -task.max_delta, task.max_delta)
        self._delta.publish(to_msg(DeltaCommand(tick.stamp, task.joint_names, delta)))
        self._gate.publish(to_msg(_expert_decision(tick)))
        self._answers += 1
        self._slowest = max(self._slowest, time.perf_counter() - started)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._enabled = request.data
        response.success = True
        response.message = "answers states" if request.data else "silent: the robot holds"
        return response

    def _report(self) -> None:
        waiting = self._task is None
        health = Health(
            self.get_clock().now().nanoseconds,
            Level.WARN if waiting else Level.OK,
            "agent_node: policy",
            "no task_description yet" if waiting else "driving" if self._enabled else "disabled",
            {"answers": str(self._answers), "slowest_answer_ms": f"{self._slowest * 1e3:.3f}"},
        )
        self._slowest = 0.0
        self._diagnostics.publish(to_msg(health))


def _expert_decision(tick: Tick) -> GateDecision:
    return GateDecision(
        stamp=tick.stamp,
        level=Level.OK,
        actor=Actor.EXPERT,
        reason="the expert is the policy",
        uncertainty=math.nan,
        threshold=math.nan,
        measure="none",
        episode=tick.status.episode,
        step=tick.status.step,
    )


def main() -> None:
    """Run the node."""
    run_node(AgentNode, AgentParams, "agent_node", "Drive the robot with a learned policy, one decision per state.")


if __name__ == "__main__":
    main()
