"""What the gate of the agent node does about each fault: the rows of docs/faults.md that are its own."""

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.duration import Duration
from rled_msgs_py.processes import Child, program
from rled_msgs_py.records import Actor, DeltaCommand, GateCode, GateDecision, Text
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.ros.node import advertise, subscribe
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import HUMAN_JOINT_DELTA, ROBOT_DESCRIPTION, SAFETY_GATE, TASK_DESCRIPTION, Qos
from std_srvs.srv import SetBool

from ..graph.team import actor_like
from .plant import DEEP, WAIT_TIMEOUT, Peer, Plant, learning_process

Take = Callable[[str, str, float, list[str]], None]
JOINTS = ("shoulder", "elbow")
MOTION = (0.004, -0.003)
SURE, UNSURE = 1e6, 0.0
AHEAD = 1_000_000_000
"""So much newer (ns) than what was heard last is a state that is newer than whatever is still on its way."""


class Gate:
    """An agent node beside a plant, and a person who may send it anything."""

    def __init__(self, plant: Plant, agent: Path, expert: Path) -> None:
        self.plant = plant
        self.decisions: list[GateDecision] = []
        subscribe(plant.node, replace(SAFETY_GATE, qos=Qos(depth=DEEP)), self.decisions.append)
        self.person = advertise(plant.node, HUMAN_JOINT_DELTA)
        self._options = ["--expert", expert, "--agent", agent, "--threshold", SURE, "--measure", "iqr"]
        self._options += ["--learning-state", agent.with_name("learning.safetensors"), "--learning-priority", "low"]
        self.peer = Peer(plant, "agent_node", self.start())
        plant.wait(lambda: bool(self.decisions) and bool(self.person.get_subscription_count()), "the agent")

    def start(self) -> Child:
        command = [*program("rled_agent", "agent_node"), *map(str, self._options)]
        return self.plant.children.start(command, echo=False)

    def command(self, delta: tuple[float, ...] = MOTION, names: tuple[str, ...] = JOINTS, late: int = 0) -> Any:
        return to_msg(DeltaCommand(self.plant.tick.stamp - late, names, delta))

    def decided(self, wanted: Callable[[GateDecision], bool]) -> Callable[[], bool]:
        """Whether there has been such a decision since now."""
        begun = len(self.decisions)
        return lambda: any(map(wanted, self.decisions[begun:]))

    def refused(self, topic: str) -> Callable[[], bool]:
        """Whether a report tells of one more refusal on a topic than now."""
        reports = [each for each in self.plant.health if each.name == "agent_node: policy"]
        before, begun = int(reports[-1].values.get(f"refused {topic}", 0)) if reports else 0, len(self.plant.health)
        return lambda: any(int(each.values.get(f"refused {topic}", 0)) > before for each in self.plant.health[begun:])

    def await_agent(self) -> None:
        self.plant.wait(self.decided(lambda each: each.actor is Actor.AGENT), "the agent's turn")


@pytest.fixture(scope="module")
def gate(ros_domain: int, planar_expert: Path, planar_bag: Path, tmp_path_factory) -> Iterator[Gate]:
    agent = actor_like(planar_expert, tmp_path_factory.mktemp("gate") / "actor.safetensors")
    options = ["--robot", "planar", "--start-points", str(planar_bag), "--mode", "real_time", "--joint-margin", "0.05"]
    with Plant(*options) as plant:
        yield Gate(plant, agent, planar_expert)


def changed(**fields: Any) -> Callable[[Gate], Any]:
    """A person's valid command but for these fields."""

    def message(gate: Gate) -> Any:
        made = gate.command()
        for name, value in fields.items():
            setattr(made, name, value)
        return made

    return message


BAD = {
    "a person's displacement that is NaN": changed(position=[float("nan"), 0.0]),
    "a person's displacement larger than Δq_max": changed(position=[0.2, 0.0]),
    "a person's command for a joint of another robot": changed(name=["shoulder", "wrist"]),
    "a person's command without names": changed(name=[], position=[]),
    "a person's command for a state 2 s ago": lambda gate: gate.command(late=2_000_000_000),
    "a person's command for a state yet to come": lambda gate: gate.command(late=-10_000_000_000),
}


@pytest.mark.parametrize("fault", BAD)
def test_a_person_who_asks_for_the_impossible_does_not_take_over(gate: Gate, row: Take, fault: str) -> None:
    plant, since, begun = gate.plant, len(gate.plant.ticks) - 1, len(gate.decisions)
    plant.wait(lambda: plant.tick.stamp > 2_000_000_000, "2 s of simulation")
    message = BAD[fault](gate)
    took = plant.measure(lambda: gate.person.publish(message), gate.refused("human/joint_delta"), fault)
    gate.await_agent()
    assert all(each.actor is not Actor.HUMAN for each in gate.decisions[begun:])
    row(fault, "refused; the agent goes on", took, plant.outside_limits(since))


def test_a_person_takes_over_and_lets_go(gate: Gate, row: Take) -> None:
    plant, since = gate.plant, len(gate.plant.ticks) - 1
    by_person = gate.decided(lambda each: each.code is GateCode.HUMAN)

    def drive() -> bool:
        gate.person.publish(gate.command())
        return by_person()

    took = plant.measure(drive, drive, "the person's turn")
    row("a person takes over", "the person acts, control passes over 5 steps", took, plant.outside_limits(since))
    took = plant.measure(lambda: None, gate.decided(lambda each: each.actor is Actor.AGENT), "the agent's turn")
    row(
        "a person's commands stop",
        "hold, then after human_timeout (300 ms) the agent",
        took,
        plant.outside_limits(since),
    )


def test_an_unsure_agent_does_not_act(gate: Gate, row: Take) -> None:
    plant, since = gate.plant, len(gate.plant.ticks) - 1
    by_expert = gate.decided(lambda each: each.code is GateCode.UNSURE)
    took = plant.measure(lambda: gate.peer.set(threshold=UNSURE), by_expert, "the expert's turn")
    assert gate.decisions[-1].actor is Actor.EXPERT
    row("the agent is unsure", "the expert acts", took, plant.outside_limits(since))
    asks = gate.decided(lambda each: each.code is GateCode.ASKING)
    took = plant.measure(lambda: gate.peer.set(query_timeout=0.5), asks, "the question")
    row("the agent is unsure, query mode", "hold, a person is asked", took, plant.outside_limits(since))
    by_expert = gate.decided(lambda each: each.code is GateCode.UNSURE)
    took = plant.measure(lambda: None, by_expert, "the expert's turn")
    row("nobody answers the question for 500 ms", "the expert acts", took, plant.outside_limits(since))
    gate.peer.set(threshold=SURE, query_timeout=0.0)
    gate.await_agent()


def test_the_emergency_stop_of_the_gate_silences_it(gate: Gate, row: Take) -> None:
    plant, since = gate.plant, len(gate.plant.ticks) - 1
    stopped = gate.decided(lambda each: each.code is GateCode.STOPPED)
    took = plant.measure(lambda: gate.peer.call(SetBool, "estop", data=True), stopped, "the stop")
    gate.person.publish(gate.command())
    held = len(plant.ticks)
    plant.wait(lambda: len(plant.ticks) > held + 20, "ticks")
    still = [tick.joints.position for tick in plant.ticks[held + 5 :]]
    assert all(np.array_equal(q, still[0]) for q in still)
    row("the gate's emergency stop, a person commands", "no answer: hold", took, plant.outside_limits(since))
    assert gate.peer.call(SetBool, "estop", data=False).success
    gate.await_agent()


@pytest.mark.parametrize(
    ("fault", "topic", "text"),
    [
        ("a task description that is no JSON", TASK_DESCRIPTION, "{"),
        ("a task description of another robot", TASK_DESCRIPTION, "panda"),
        ("a robot description that is no URDF", ROBOT_DESCRIPTION, "<robot"),
    ],
)
def test_a_description_that_does_not_fit_changes_nothing(gate: Gate, row: Take, fault, topic, text) -> None:
    plant, since = gate.plant, len(gate.plant.ticks) - 1
    if text == "panda":
        text = replace(plant.task, robot="panda").to_json()
    rogue = advertise(plant.node, topic)
    plant.wait(rogue.get_subscription_count, "the agent")
    took = plant.measure(lambda: rogue.publish(to_msg(Text(text))), gate.refused(topic.name), fault)
    plant.node.destroy_publisher(rogue)
    gate.await_agent()
    row(fault, "refused; the agent goes on with the one it has", took, plant.outside_limits(since))


def test_a_state_of_another_robot_is_not_answered(gate: Gate, row: Take) -> None:
    plant, since = gate.plant, len(gate.plant.ticks) - 1
    rogues = [advertise(plant.node, topic) for topic in STATE_TOPICS]
    plant.wait(lambda: all(each.get_subscription_count() for each in rogues), "the agent")
    assert plant.call(SetBool, "pause", data=True).success  # no tick between the parts of the rogue's
    tick, stamp = plant.tick, plant.tick.stamp + AHEAD
    wrong = replace(tick.joints, stamp=stamp, names=("panda_joint1", "panda_joint2"))
    records = [wrong, *(replace(each, stamp=stamp) for each in tick[1:])]

    def act() -> None:
        for output, record in zip(rogues, records, strict=True):
            output.publish(to_msg(record))
            assert output.wait_for_all_acked(Duration(seconds=WAIT_TIMEOUT))
        assert plant.call(SetBool, "pause", data=False).success

    took = plant.measure(act, gate.decided(lambda each: each.actor is Actor.AGENT), "the agent's turn")
    for each in rogues:
        plant.node.destroy_publisher(each)
    assert all(each.stamp != stamp for each in gate.decisions)
    plant.ticks[:] = [each for each in plant.ticks if each.joints.names == JOINTS]
    row("a state with joints of another robot", "passed over; the agent goes on", took, plant.outside_limits(since))


def test_a_parameter_of_the_gate_out_of_its_range_is_refused(gate: Gate, row: Take) -> None:
    plant, since, reasons = gate.plant, len(gate.plant.ticks) - 1, list[str]()
    took = plant.measure(lambda: reasons.append(gate.peer.set(hysteresis=2.0)), lambda: reasons, "an answer")
    assert reasons[0]
    row("hysteresis of 2", "refused, with the reason", took, plant.outside_limits(since))


def test_what_a_limit_forbids_the_agent_somebody_else_does_or_nobody(gate: Gate, row: Take) -> None:
    plant, since = gate.plant, len(gate.plant.ticks) - 1
    box = replace(plant.task.limits, tip_lower=(2.0, 2.0, 0.0), tip_upper=(3.0, 3.0, 1.0))  # out of reach
    output = advertise(plant.node, TASK_DESCRIPTION)
    plant.wait(output.get_subscription_count, "the agent")
    forbidden = gate.decided(lambda each: each.code is GateCode.LIMIT)
    before = plant.task

    def act() -> None:
        output.publish(to_msg(Text(replace(before, limits=box).to_json())))

    took = plant.measure(act, forbidden, "a decision")
    decision = next(each for each in reversed(gate.decisions) if each.code is GateCode.LIMIT)
    assert decision.actor in (Actor.EXPERT, Actor.HOLD)
    output.publish(to_msg(Text(before.to_json())))
    gate.await_agent()
    plant.node.destroy_publisher(output)
    row(
        "a limit forbids what the agent wants",
        "the expert acts if it may, else hold",
        took,
        plant.outside_limits(since),
    )


def test_the_learning_process_dies_and_control_goes_on(gate: Gate, row: Take) -> None:
    plant, since = gate.plant, len(gate.plant.ticks) - 1
    assert gate.peer.call(SetBool, "learn", data=True).success
    plant.wait(lambda: bool(learning_process(gate.peer.child)), "the learning process")
    begun = len(plant.health)
    told = lambda: any("learning process has ended" in each.message for each in plant.health[begun:])  # noqa: E731
    took = plant.measure(lambda: os.kill(learning_process(gate.peer.child)[0], signal.SIGKILL), told, "a report")
    gate.await_agent()
    row("the learning process is killed", "reported; the agent goes on", took, plant.outside_limits(since))
    assert gate.peer.call(SetBool, "learn", data=False).success


def test_the_agent_dies_and_the_robot_holds(gate: Gate, row: Take) -> None:
    plant, since = gate.plant, len(gate.plant.ticks) - 1

    def is_still() -> bool:
        last = [each.joints.position for each in plant.ticks[-10:]]
        return all(np.array_equal(q, last[0]) for q in last)

    took = plant.measure(gate.peer.child.process.kill, is_still, "a hold")
    row("the agent is killed", "hold; 200 ms of them are looked at", took, plant.outside_limits(since))
    plant.children.end(gate.peer.child)
    began = gate.decided(lambda each: each.actor is Actor.AGENT)
    took = plant.measure(lambda: setattr(gate.peer, "child", gate.start()), began, "the agent's turn")
    row("the agent is started again", "it answers", took, plant.outside_limits(since))
