"""The gate of the agent node: its settings, and a learned actor behind it that learns beside control."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rled_agent.nn.policy import GateSettings, Origin, load_policy
from rled_agent.nodes.agent_node import AgentNode
from rled_agent.nodes.agent_params import AgentParams
from rled_agent.training.checkpoint import read_checkpoint
from rled_msgs_py.errors import ContractError
from rled_msgs_py.processes import program
from rled_msgs_py.records import Actor, GateCode, Level
from rled_msgs_py.ros.node import fresh_context
from std_srvs.srv import SetBool, Trigger

from .team import actor_like

NAME = "agent_node: policy"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("agent")


@pytest.fixture(scope="module")
def agent(planar_expert: Path, folder: Path) -> Path:
    return actor_like(planar_expert, folder / "actor.safetensors")


@pytest.fixture(scope="module")
def gated(observer, children, planar_expert: Path, agent: Path, folder: Path):
    """The observer of a graph that is driven through a gate."""
    options = ["--expert", planar_expert, "--agent", agent, "--threshold", 0.0, "--measure", "iqr", "--noise", 0.1]
    options += ["--learning-state", folder / "learning" / "state.safetensors", "--learning-priority", "low"]
    children.start([*program("rled_agent", "agent_node"), *map(str, options)])
    observer.wait(lambda: bool(observer.decisions), "the first decision")
    return observer


def set_parameters(observer, **wanted) -> None:
    messages = [Parameter(name, value=value).to_parameter_msg() for name, value in wanted.items()]
    answer = observer.call(SetParameters, "agent_node/set_parameters", parameters=messages)
    assert all(result.successful for result in answer.results)


def decide_by(observer, threshold: float, measure: str) -> list:
    """Set both; returns 200 decisions made with them."""
    set_parameters(observer, threshold=threshold, measure=measure)
    begun = len(observer.decisions)

    def decided() -> list:
        return [each for each in observer.decisions[begun:] if (each.threshold, each.measure) == (threshold, measure)]

    observer.wait(lambda: len(decided()) >= 200, "200 decisions")
    return decided()


def test_at_a_threshold_of_zero_the_expert_stands_in(gated) -> None:
    for decision in decide_by(gated, 0.0, "iqr"):
        assert (decision.actor, decision.level) == (Actor.EXPERT, Level.WARN)
        assert decision.uncertainty >= 0.0
        assert decision.reason == f"iqr {decision.uncertainty:.3g} >= threshold 0"


def test_parameters_of_a_running_node_move_the_gate(gated) -> None:
    decisions = decide_by(gated, 0.5, "qcd")
    for decision in decisions:
        assert (decision.actor is Actor.EXPERT) == (decision.uncertainty >= 0.5)
        assert decision.level is (Level.WARN if decision.actor is Actor.EXPERT else Level.OK)
    assert {decision.actor for decision in decisions} == {Actor.AGENT, Actor.EXPERT}
    assert {each.actor for each in decide_by(gated, 1e6, "iqr")} == {Actor.AGENT}


def test_with_phi_the_expert_drives_whole_episodes(gated) -> None:
    set_parameters(gated, threshold=1e6, measure="iqr", phi=0.5)
    begun = gated.decisions[-1].episode + 1
    try:
        gated.wait(lambda: gated.decisions[-1].episode >= begun + 16, "sixteen episodes")
    finally:
        set_parameters(gated, phi=0.0)
    drivers = [
        {(each.actor, each.code) for each in gated.decisions if each.episode == episode}
        for episode in range(begun, begun + 16)
    ]
    drawn, own = {(Actor.EXPERT, GateCode.DRAWN)}, {(Actor.AGENT, GateCode.SURE)}
    assert all(each in (drawn, own) for each in drivers)
    assert drawn in drivers
    assert own in drivers


def test_a_threshold_out_of_range_is_refused(gated) -> None:
    for name, value in (("threshold", -0.5), ("measure", "variance")):
        message = Parameter(name, value=value).to_parameter_msg()
        (result,) = gated.call(SetParameters, "agent_node/set_parameters", parameters=[message]).results
        assert not result.successful
        assert result.reason
    gated.wait_ticks(10)


def test_the_agent_learns_in_a_process_of_its_own(gated, agent, folder) -> None:
    state = folder / "learning" / "state.safetensors"
    assert gated.call(SetBool, "agent_node/learn", data=True).success
    report = gated.wait_report(NAME, lambda health: int(health.values.get("handovers", 0)) > 1)
    assert report.level is Level.OK
    assert gated.call(SetBool, "agent_node/learn", data=False).success
    gated.wait(state.exists, "the state of learning")
    assert read_checkpoint(state).state["replay.added"] > 500
    assert gated.call(Trigger, "agent_node/save").success
    learned = load_policy(state.with_name("policy.safetensors")).network.vector()
    assert not (learned == load_policy(agent).network.vector()).all()
    gated.wait_ticks(10)


# What the gate compares comes with the policy unless it is given, and the node's parameters show it.


TRAINED = GateSettings("iqr", 0.25, 12)
NAMES = ("threshold", "measure", "passes")


@pytest.fixture
def node(planar_expert: Path, tmp_path: Path) -> Iterator[Callable[..., AgentNode]]:
    """Makes the node with a policy that learned behind a gate, and parameters as a command line gives them."""
    made: list[AgentNode] = []
    context = fresh_context()

    def make(gate: GateSettings | None = TRAINED, **given: Any) -> AgentNode:
        path = actor_like(planar_expert, tmp_path / f"actor-{len(made)}.safetensors")
        replace(load_policy(path), origin=Origin("mc_rled", gate)).save(path)
        given = {"expert": str(planar_expert), "agent": str(path)} | given
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        made.append(AgentNode(parameter_overrides=overrides, context=context))
        return made[-1]

    yield make
    for each in made:
        each.destroy_node()
    context.try_shutdown()


def shown(node: AgentNode) -> GateSettings:
    threshold, measure, passes = (node.get_parameter(name).value for name in NAMES)
    return GateSettings(measure, threshold, passes)


def used(node: AgentNode) -> GateSettings:
    params = node._params
    return GateSettings(params.measure, params.threshold, params.passes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, TRAINED),
        ({"threshold": 0.5}, replace(TRAINED, threshold=0.5)),
        ({"threshold": 0.0, "measure": "qcd"}, GateSettings("qcd", 0.0, 12)),
        ({"measure": "qcd", "passes": 7}, GateSettings("qcd", 0.25, 7)),
        ({"threshold": 1.0, "measure": "qcd", "passes": 2}, GateSettings("qcd", 1.0, 2)),
    ],
)
def test_what_is_not_given_is_as_the_policy_was_trained(node, given, expected) -> None:
    made = node(**given)
    assert shown(made) == used(made) == expected


def test_a_policy_that_says_nothing_is_compared_as_the_thesis_does(node) -> None:
    made = node(gate=None)
    assert shown(made) == used(made) == GateSettings("qcd", 1e-3, 30)


def test_the_expert_alone_has_nothing_to_compare(node) -> None:
    made = node(agent="")
    assert made.get_parameter("threshold").value == 1e-3


def test_a_running_node_goes_back_to_what_was_trained(node) -> None:
    made = node()
    for name, value, expected in (
        ("threshold", 0.5, replace(TRAINED, threshold=0.5)),
        ("passes", 5, replace(TRAINED, threshold=0.5, passes=5)),
        ("threshold", -1.0, replace(TRAINED, passes=5)),
        ("measure", "qcd", GateSettings("qcd", 0.25, 5)),
        ("measure", "trained", replace(TRAINED, passes=5)),
        ("passes", 0, TRAINED),
    ):
        assert made.set_parameters([Parameter(name, value=value)])[0].successful
        assert shown(made) == used(made) == expected


@pytest.mark.parametrize(
    ("name", "value"), [("threshold", -0.5), ("threshold", -2.0), ("passes", 1), ("measure", "std")]
)
def test_a_running_node_refuses_what_compares_nothing(node, name, value) -> None:
    made = node()
    assert not made.set_parameters([Parameter(name, value=value)])[0].successful
    assert shown(made) == used(made) == TRAINED


def test_a_running_node_without_an_expert_refuses_phi(node) -> None:
    made = node(expert="")
    (answer,) = made.set_parameters([Parameter("phi", value=0.5)])
    assert not answer.successful
    assert "phi is 0.5 without an expert; accepted: 0" in answer.reason
    assert made.get_parameter("phi").value == made._params.phi == 0.0


def test_a_node_that_starts_says_nothing_of_faults(node, capfd) -> None:
    node()
    assert "Error" not in capfd.readouterr().err


@pytest.mark.parametrize("given", [{"threshold": -0.5}, {"passes": 1}])
def test_parameters_that_compare_nothing_are_refused_at_the_start(given) -> None:
    with pytest.raises(ContractError, match=f"{next(iter(given))} is .*; accepted: "):
        AgentParams(**given)


def test_the_log_says_what_is_compared_and_where_it_comes_from(node, capfd) -> None:
    for given, said in (
        ({}, "the gate: iqr, threshold 0.25, 12 passes (as the policy was trained)"),
        (
            {"threshold": 0.5},
            "the gate: iqr, threshold 0.5, 12 passes (threshold given; else as the policy was trained)",
        ),
        ({"gate": None}, "the gate: qcd, threshold 0.001, 30 passes (the policy says nothing of a gate)"),
    ):
        node(**given)
        assert said in capfd.readouterr().err
