"""A person beside the agent: takes over, lets go, is asked, is learned from; and the gate's emergency stop."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rled_agent.nn.policy import load_policy
from rled_agent.training.checkpoint import read_checkpoint
from rled_msgs_py.processes import program
from rled_msgs_py.records import Actor, DeltaCommand, GateCode, GateDecision, Level, Text
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.ros.node import advertise
from rled_msgs_py.topics import HUMAN_JOINT_DELTA, TASK_DESCRIPTION
from std_srvs.srv import SetBool

from .team import actor_like

NAME = "agent_node: policy"
JOINTS = ("shoulder", "elbow")
MOTION = np.array([0.004, -0.003])


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("takeover") / "learning.safetensors"


@pytest.fixture(scope="module")
def graph(observer, children, planar_expert: Path, state: Path):
    """The observer of a graph that an actor with dropout drives, always sure of itself."""
    agent = actor_like(planar_expert, state.with_name("actor.safetensors"))
    options = ["--expert", planar_expert, "--agent", agent, "--threshold", 1e6, "--measure", "iqr"]
    options += ["--learning-state", state, "--learning-priority", "low"]
    options += ["--human-timeout", 3.0]  # a busy machine holds the person up
    children.start([*program("rled_agent", "agent_node"), *map(str, options)])
    observer.wait(lambda: bool(observer.decisions), "the first decision")
    return observer


@pytest.fixture(scope="module")
def say(graph) -> Callable[..., None]:
    """Publish a person's command for the newest state."""
    output = advertise(graph.node, HUMAN_JOINT_DELTA)
    graph.wait(output.get_subscription_count, "the agent")

    def publish(delta: np.ndarray = MOTION, names: tuple[str, ...] = JOINTS) -> None:
        output.publish(to_msg(DeltaCommand(graph.ticks[-1].stamp, names, delta)))

    return publish


def configure(graph, **values) -> None:
    messages = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    answer = graph.call(SetParameters, "agent_node/set_parameters", parameters=messages)
    assert all(result.successful for result in answer.results), answer.results


def await_decision(graph, wanted: Callable[[GateDecision], bool], what: str, begun: int | None = None) -> GateDecision:
    begun = len(graph.decisions) if begun is None else begun
    graph.wait(lambda: any(map(wanted, graph.decisions[begun:])), what)
    return next(filter(wanted, graph.decisions[begun:]))


def drive(graph, say, steps: int) -> list[np.ndarray]:
    """Drive so many steps; returns the displacements that the gate gave out for them."""
    begun = len(graph.decisions)

    def driven() -> list[int]:
        return [each.stamp for each in graph.decisions[begun:] if each.actor is Actor.HUMAN]

    for step in range(steps):
        say()
        graph.wait(lambda step=step: len(driven()) > step, "the person's turn")
        graph.wait(lambda: graph.ticks[-1].stamp > driven()[-1], "the tick after it")
    graph.wait(lambda: graph.deltas[-1].stamp >= driven()[-1], "the command")
    answers = {delta.stamp: delta.delta for delta in graph.deltas}
    return [answers[stamp] for stamp in driven()]


def test_a_person_takes_over_smoothly_and_lets_go(graph, say) -> None:
    given = drive(graph, say, 12)
    assert len(given) == 12
    jumps = np.abs(np.diff([*given], axis=0)).max(axis=1)
    assert (np.diff(jumps[:4]) <= 1e-12).all()  # the same part of the way in each step
    np.testing.assert_allclose(given[5:], np.tile(MOTION, (7, 1)), atol=1e-12)
    decision = next(each for each in reversed(graph.decisions) if each.actor is Actor.HUMAN)
    assert (decision.level, decision.code, decision.reason) == (Level.WARN, GateCode.HUMAN, "a person drives")
    assert decision.uncertainty >= 0.0
    await_decision(graph, lambda each: each.actor is Actor.AGENT, "the agent's turn")


@pytest.mark.parametrize(("delta", "names"), [(MOTION, ("shoulder", "wrist")), (MOTION * 100, JOINTS)])
def test_a_person_who_asks_for_the_impossible_does_not_take_over(graph, say, delta, names) -> None:
    before = graph.wait_report(NAME, lambda _: True)
    count = int(before.values.get("refused human/joint_delta", 0))
    begun = len(graph.decisions)
    say(delta, names)
    graph.wait_report(NAME, lambda health: int(health.values.get("refused human/joint_delta", 0)) == count + 1)
    assert all(each.actor is Actor.AGENT for each in graph.decisions[begun:])


def test_what_a_person_did_is_marked_for_the_learner(graph, say, state) -> None:
    assert graph.call(SetBool, "agent_node/learn", data=True).success
    graph.wait_report(NAME, lambda health: int(health.values.get("offered", 0)) > 0)
    configure(graph, human_timeout=3.0)  # beside a learner, a person's first command may be many states late
    drive(graph, say, 30)
    configure(graph, human_timeout=0.3)
    await_decision(graph, lambda each: each.actor is Actor.AGENT, "the agent's turn")
    assert graph.call(SetBool, "agent_node/learn", data=False).success
    graph.wait(state.exists, "the state of learning")
    (rows,) = read_checkpoint(state).tensors["by_person.rows"].numpy()
    assert 28 <= len(rows) <= 30  # a transition that ends an episode's turn over is not one
    policy = load_policy(state.with_name("actor.safetensors"))
    actions = policy.scaling.denormalize_action(rows[:, 4:6])
    assert (np.abs(actions - MOTION).max(axis=1) < 1e-6).sum() >= 20  # the rest were passing control


def test_the_gate_stops_at_once_and_goes_on_when_released(graph) -> None:
    assert graph.call(SetBool, "agent_node/estop", data=True).message == "stopped until released"
    report = graph.wait_report(NAME, lambda health: health.message == "emergency stop")
    assert report.level is Level.ERROR
    graph.wait(lambda: graph.decisions[-1].code is GateCode.STOPPED, "its decision")
    graph.wait(lambda: graph.ticks[-1].stamp >= graph.decisions[-1].stamp, "the state that it was stopped in")
    heard = len(graph.ticks)
    graph.wait_report(NAME, lambda health: health.message == "emergency stop")
    assert len(graph.ticks) == heard
    assert (graph.decisions[-1].actor, graph.decisions[-1].stamp) == (Actor.HOLD, graph.ticks[-1].stamp)
    assert graph.call(SetBool, "agent_node/estop", data=False).message == "released"
    graph.wait_ticks(10)


def test_where_it_is_unsure_it_asks_and_the_person_or_in_the_end_the_expert_acts(graph, say) -> None:
    begun = len(graph.decisions)  # it asks once, maybe before the answer to this has come
    configure(graph, threshold=0.0, query_timeout=1.0)
    asked = await_decision(graph, lambda each: each.code is GateCode.ASKING, "the question", begun)
    assert (asked.actor, asked.level) == (Actor.HOLD, Level.ERROR)
    assert "a person is asked" in asked.reason
    drive(graph, say, 3)

    def since_the_person() -> list[GateCode]:
        codes = [each.code for each in graph.decisions]
        return codes[len(codes) - codes[::-1].index(GateCode.HUMAN) :]

    graph.wait(lambda: GateCode.UNSURE in since_the_person(), "the expert's turn")
    assert since_the_person()[0] is GateCode.ASKING
    configure(graph, threshold=1e6, query_timeout=0.0)
    await_decision(graph, lambda each: each.actor is Actor.AGENT, "the agent's turn")


@pytest.mark.parametrize("text", ["no JSON", "{}", '{"robot": "panda"}'])
def test_a_description_that_makes_no_sense_changes_nothing(graph, text) -> None:
    rogue = advertise(graph.node, TASK_DESCRIPTION)
    graph.wait(rogue.get_subscription_count, "the agent")
    before = graph.wait_report(NAME, lambda _: True)
    count = int(before.values.get("refused task_description", 0))
    rogue.publish(to_msg(Text(text)))
    graph.wait_report(NAME, lambda health: int(health.values.get("refused task_description", 0)) == count + 1)
    graph.node.destroy_publisher(rogue)
    graph.wait_ticks(10)
