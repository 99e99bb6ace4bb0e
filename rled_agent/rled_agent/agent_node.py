"""Node: answers every state with joint displacements, and says on ``safety_gate`` who acts and why."""

import time
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rclpy.node import Node
from rled_msgs_py.command_output import CommandOutput
from rled_msgs_py.convert import to_msg
from rled_msgs_py.errors import RledError
from rled_msgs_py.node import advertise, declare, run_node, subscribe, subscribe_ticks
from rled_msgs_py.params import param
from rled_msgs_py.records import DeltaCommand, Health, Level, Text
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import DIAGNOSTICS, SAFETY_GATE, TASK_DESCRIPTION
from std_srvs.srv import SetBool, Trigger

from rled_agent.apprentice import Apprentice
from rled_agent.controller import Answer, GatedController, GateSettings, load_controller, observe

Service = SetBool | Trigger


@dataclass(frozen=True)
class AgentParams:
    """Parameters of the agent node."""

    expert: str = param("out/expert/expert.safetensors", "weights that train_expert wrote", read_only=True)
    agent: str = param("", "policy that train_agent wrote; empty: the expert drives alone", read_only=True)
    threshold: float = param(1e-3, "ξ: at this uncertainty or more the expert acts", low=0.0, high=1e9)
    measure: str = param("qcd", "uncertainty that is compared with the threshold", choices=("qcd", "iqr"))
    passes: int = param(30, "N, stochastic passes of the actor", low=2, high=10_000, read_only=True)
    noise: float = param(0.0, "deviation of exploration noise, in halves of the action range", low=0.0, high=10.0,
                         read_only=True)  # fmt: skip
    seed: int = param(0, "seed of dropped units and noise", low=0, high=2**31 - 1, read_only=True)
    learning_state: str = param("out/agent_node/learning.safetensors", "where ~/learn keeps its state", read_only=True)
    enabled: bool = param(True, "answer states; ~/enable switches it", read_only=True)

    def gate(self) -> GateSettings:
        """What the gate needs of them."""
        return GateSettings(self.threshold, self.measure, self.passes, self.noise, self.seed)  # type: ignore[arg-type]


class AgentNode(Node):
    """Drives the robot with a learned policy, one answer and one gate decision for each state.

    Subscribes: joint_states, ee_pose, target_pose, task_status, task_description.
    Publishes: joint_delta, safety_gate, /diagnostics.
    Services: ~/enable, ~/learn (std_srvs/SetBool), ~/save (std_srvs/Trigger).
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("agent_node", **arguments)
        torch.set_num_threads(1)
        torch.set_flush_denormal(True)
        self._params = declare(self, AgentParams, self._on_change)
        self._controller = load_controller(self._params.expert, self._params.agent, self._params.gate())
        self._task: TaskDescription | None = None
        self._enabled = self._params.enabled
        self._apprentice: Apprentice | None = None
        self._before: tuple[Tick, NDArray[np.float64], Answer] | None = None
        self._unanswered: Tick | None = None
        self._answers, self._slowest = 0, 0.0
        self._delta, self._gate = CommandOutput(self), advertise(self, SAFETY_GATE)
        self._diagnostics = advertise(self, DIAGNOSTICS)
        subscribe(self, TASK_DESCRIPTION, self._on_task)
        subscribe_ticks(self, self._on_tick)
        self.create_service(SetBool, "~/enable", self._on_enable)
        self.create_service(SetBool, "~/learn", self._on_learn)
        self.create_service(Trigger, "~/save", self._on_save)
        self.create_timer(1.0, self._report)

    def _on_change(self, params: AgentParams) -> None:
        if isinstance(self._controller, GatedController):
            self._controller.configure(params.threshold, params.measure)  # type: ignore[arg-type]

    def _on_task(self, text: Text) -> None:
        task = TaskDescription.from_json(text.data)
        task.require_same_robot(self._controller.policy.task, "the policy")
        self._task = task

    def _on_tick(self, tick: Tick) -> None:
        started = time.perf_counter()
        self._delta.withdraw()
        observation = observe(self._controller.policy.task, tick)
        self._learn_from(tick, observation)
        over = tick.status.terminated or tick.status.truncated
        self._before = None
        self._unanswered = None if over or self._enabled else tick
        if over or not self._enabled:
            return
        answer = self._controller.answer(tick, observation)
        self._delta.publish(DeltaCommand(tick.stamp, self._controller.policy.task.joint_names, answer.delta))
        self._gate.publish(to_msg(answer.decision))
        self._before = (tick, observation, answer)
        self._answers += 1
        self._slowest = max(self._slowest, time.perf_counter() - started)

    def _learn_from(self, tick: Tick, observation: NDArray[np.float64]) -> None:
        """Offer the transition that this tick ends, and take newer weights."""
        if self._apprentice is None or self._before is None:
            return
        before, observation_before, answer = self._before
        if tick.status.episode == before.status.episode and tick.status.step == before.status.step + 1:
            scaling = self._controller.policy.scaling
            outcome = np.array([tick.status.reward, tick.status.terminated], dtype=np.float32)
            states = map(scaling.normalize_observation, (observation_before, observation))
            state, following = states
            self._apprentice.offer(np.concatenate([state, answer.action, outcome, following]))
        self._apprentice.renew()

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._enabled = request.data
        if self._enabled and self._unanswered is not None:
            self._on_tick(self._unanswered)  # in lockstep the simulation still waits for this answer
        return _say(response, True, "answers states" if request.data else "silent: the robot holds")

    def _on_learn(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data and not self._params.agent:
            return _say(response, False, "the expert does not learn; start with --agent POLICY")
        if request.data and self._apprentice is None:
            state = Path(self._params.learning_state)
            self._apprentice = Apprentice(self._controller.policy.network, Path(self._params.agent), state)
        elif not request.data and self._apprentice is not None:
            Thread(target=self._apprentice.close).start()  # it saves its state first, and control does not wait
            self._apprentice = None
        return _say(response, True, "learning" if request.data else "not learning")

    def _on_save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        path = Path(self._params.learning_state)
        if self._apprentice is not None:
            self._apprentice.save()
        try:
            self._controller.policy.save(path.with_name("policy.safetensors"))
        except (OSError, RledError) as error:
            return _say(response, False, str(error))
        return _say(response, True, f"saved into {path.parent}")

    def _report(self) -> None:
        waiting = self._task is None
        values = {"answers": str(self._answers), "slowest_answer_ms": f"{self._slowest * 1e3:.3f}"}
        level, message = Level.OK, "driving" if self._enabled else "disabled"
        if self._apprentice is not None:
            learning = self._apprentice
            values |= {name: str(getattr(learning, name)) for name in ("offered", "dropped", "handovers")}
            if not learning.running:
                level, message = Level.ERROR, "the learning process has ended; call ~/learn again"
        if waiting:
            level, message = Level.WARN, "no task_description yet"
        self._slowest = 0.0
        now = self.get_clock().now().nanoseconds
        self._diagnostics.publish(to_msg(Health(now, level, "agent_node: policy", message, values)))

    def destroy_node(self) -> None:
        """End the learning process, which saves its state, with the node."""
        apprentice: Apprentice | None = getattr(self, "_apprentice", None)
        if apprentice is not None:
            apprentice.close()
        super().destroy_node()


def _say(response: Any, success: bool, message: str) -> Any:
    response.success, response.message = success, message
    return response


def main() -> None:
    """Run the node."""
    run_node(AgentNode, AgentParams, "agent_node", "Drive the robot with a learned policy, one decision per state.")


if __name__ == "__main__":
    main()
