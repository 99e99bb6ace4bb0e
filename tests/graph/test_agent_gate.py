"""The agent node with a learned actor behind the Monte-Carlo gate, learning beside control, watched over DDS."""

from pathlib import Path

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rled_agent.nn.policy import load_policy
from rled_agent.training.checkpoint import read_checkpoint
from rled_msgs_py.processes import program
from rled_msgs_py.records import Actor, GateCode, Level
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
