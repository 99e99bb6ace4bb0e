"""What the gate compares comes with the policy unless it is given, and the node's parameters show it."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter
from rled_agent.nn.policy import GateSettings, Origin, load_policy
from rled_agent.nodes.agent_node import AgentNode
from rled_agent.nodes.agent_params import AgentParams
from rled_msgs_py.errors import ContractError
from rled_msgs_py.ros.node import fresh_context

from .team import actor_like

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
