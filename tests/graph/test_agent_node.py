"""The agent node with the expert as its policy, in a process of its own beside the simulation, watched over DDS."""

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import Policy, load_policy
from rled_agent.nn.scaling import scaling_of_bounds
from rled_agent.nodes import agent_node
from rled_msgs_py.processes import program
from rled_msgs_py.records import Actor, Level
from rled_msgs_py.tick import Tick
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task
from std_srvs.srv import SetBool

NAME = "agent_node: policy"


def is_over(tick: Tick) -> bool:
    return tick.status.terminated or tick.status.truncated


@pytest.fixture(scope="module")
def driven(observer, children, planar_expert: Path):
    """The observer of a graph whose agent has been started, but told to be silent."""
    children.start([*program("rled_agent", "agent_node"), "--expert", str(planar_expert), "--no-enabled"])
    observer.wait_report(NAME, lambda health: health.message == "disabled")
    return observer


def enable(observer, on: bool) -> None:
    answer = observer.call(SetBool, "agent_node/enable", data=on)
    assert (answer.success, answer.message) == (True, "answers states" if on else "silent: the robot holds")


def await_silence(observer) -> tuple[int, int, int]:
    """All that was under way has come: nothing between two reports. Returns how much was heard."""
    heard, before = (0, 0, 0), None
    while before != heard:
        before = heard
        observer.wait_report(NAME, lambda health: health.message == "disabled")
        heard = len(observer.ticks), len(observer.deltas), len(observer.decisions)
    return heard


def test_a_disabled_agent_is_silent_and_goes_on_when_enabled(driven) -> None:
    for _ in range(2):
        enable(driven, False)
        heard = await_silence(driven)
        driven.wait_report(NAME, lambda health: health.message == "disabled")
        assert (len(driven.ticks), len(driven.deltas), len(driven.decisions)) == heard
        enable(driven, True)
        driven.wait_ticks(20)
    assert len({delta.stamp for delta in driven.deltas}) == len(driven.deltas)


def test_every_state_gets_one_answer_and_one_decision(driven, planar_expert) -> None:
    enable(driven, True)
    begun = len(driven.ticks)

    def ends() -> list[Tick]:
        return [tick for tick in driven.ticks[begun:] if is_over(tick)]

    driven.wait(lambda: len(ends()) >= 9, "9 episodes")
    first, last = ends()[0].stamp, ends()[8].stamp
    driven.wait(lambda: driven.decisions[-1].stamp > last, "decisions on them")
    asked = [tick for tick in driven.ticks if not is_over(tick) and first < tick.stamp < last]
    deltas, decisions = (
        [each for each in heard if first < each.stamp < last] for heard in (driven.deltas, driven.decisions)
    )
    stamps = [tick.stamp for tick in asked]
    assert [delta.stamp for delta in deltas] == stamps
    assert [decision.stamp for decision in decisions] == stamps
    policy = load_policy(planar_expert)
    for tick, delta, decision in zip(asked, deltas, decisions, strict=True):
        expected = policy.act(policy.task.observe(tick.joints.position, tick.ee.position, tick.target.position))
        np.testing.assert_allclose(delta.delta, expected, atol=1e-6)
        assert delta.names == ("shoulder", "elbow")
        assert (decision.actor, decision.level, decision.measure) == (Actor.EXPERT, Level.OK, "none")
        assert (decision.episode, decision.step) == (tick.status.episode, tick.status.step)
    status = [tick.status for tick in ends()[1:9]]
    assert [each.episode for each in status] == list(range(status[0].episode, status[0].episode + 8))
    assert sum(each.targets_reached for each in status) >= 7
    assert all(each.violations == 0 for each in status)


def test_joints_move_as_answered(driven) -> None:
    enable(driven, True)
    ticks = driven.wait_ticks(100)
    answers = {delta.stamp: delta.delta for delta in driven.deltas}
    moves = [(before, after) for before, after in pairwise(ticks) if not is_over(before) and before.stamp in answers]
    assert len(moves) > 50
    for before, after in moves:
        moved = after.joints.position - before.joints.position
        np.testing.assert_allclose(moved, answers[before.stamp], atol=1e-9)


def test_the_expert_does_not_learn(driven) -> None:
    answer = driven.call(SetBool, "agent_node/learn", data=True)
    assert not answer.success
    assert "start with --agent" in answer.message


@pytest.fixture(scope="module")
def panda_weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    task = reach_task(ROBOTS["panda"]).description
    limit = np.full(7, task.max_delta)
    network = Perceptron(10, 7, Architecture(hidden=(4,), dropout=0.1), Draws([0]), squash=True)
    path = tmp_path_factory.mktemp("panda") / "panda.safetensors"
    Policy(network, scaling_of_bounds(task.observation_bounds(), (-limit, limit)), task).save(path)
    return path


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run the node in this process, which must end with code 2 and one line; returns the line."""

    def run(*options: object) -> str:
        monkeypatch.setattr(sys, "argv", ["agent_node", *map(str, options)])
        with pytest.raises(SystemExit) as ended:
            agent_node.main()
        (line,) = [line for line in capfd.readouterr().err.splitlines() if line.startswith("error: ")]
        assert ended.value.code == 2
        return line

    return run


@pytest.mark.usefixtures("children")
def test_weights_of_another_robot_end_the_node(refused, panda_weights) -> None:
    line = refused("--expert", panda_weights)
    assert "panda" in line
    assert "planar" in line or "shoulder" in line


def test_an_agent_and_an_expert_of_two_robots_end_the_node(refused, panda_weights, planar_expert) -> None:
    line = refused("--expert", planar_expert, "--agent", panda_weights)
    assert "the expert is for robot planar; accepted: panda" in line


def test_missing_or_damaged_weights_end_the_node(refused, tmp_path) -> None:
    assert f"there is no expert in {tmp_path / 'gone'}" in refused("--expert", tmp_path / "gone")
    (tmp_path / "damaged").write_bytes(b"weights")
    assert f"{tmp_path / 'damaged'} is damaged" in refused("--expert", tmp_path / "damaged")
    assert "accepted" in refused("--expert", "")


def test_a_parameter_out_of_range_ends_the_node(refused, planar_expert) -> None:
    assert "passes is 1; accepted: 2 or more, or 0" in refused("--expert", planar_expert, "--passes", 1)
