"""Hostile messages and requests for agent_node, beside a robot in lockstep that it drives."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from rled_agent.nodes.agent_params import AgentParams
from rled_msgs_py.processes import program
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import HUMAN_JOINT_DELTA, ROBOT_DESCRIPTION, TASK_DESCRIPTION
from std_srvs.srv import SetBool, Trigger

from ..graph.team import actor_like
from .hostile_requests import adjustable, requests_of
from .plant import Peer, Plant, learning_process
from .siege import Rogue, besiege, require_all, volleys

TOPICS = (*STATE_TOPICS, TASK_DESCRIPTION, ROBOT_DESCRIPTION, HUMAN_JOINT_DELTA)
VOLLEYS = volleys(TOPICS)
REQUESTS = requests_of(AgentParams, {"enable": SetBool, "estop": SetBool, "learn": SetBool, "save": Trigger})


@pytest.fixture(scope="module")
def agent(ros_domain: int, planar_expert: Path, planar_bag: Path, tmp_path_factory) -> Iterator[Peer]:
    """An actor with dropout, and the expert beside it; the robot's episodes have four steps, then it waits."""
    actor = actor_like(planar_expert, tmp_path_factory.mktemp("hostile") / "actor.safetensors")
    options = ["--expert", planar_expert, "--agent", actor, "--measure", "iqr", "--threshold", 0.1]
    options += ["--learning-state", actor.with_name("learning.safetensors"), "--learning-priority", "low"]
    episodes = ["--targets-per-episode", "0", "--max-steps", "4", "--no-auto-reset", "--joint-margin", "0.05"]
    with Plant("--robot", "planar", "--start-points", str(planar_bag), *episodes) as plant:
        command = [*program("rled_agent", "agent_node"), *map(str, options)]
        agent = Peer(plant, "agent_node", plant.children.start(command, echo=False))
        plant.wait(lambda: plant.tick.status.truncated, "the agent")
        yield agent
        plant.children.end(agent.child)
        assert agent.child.exit_code == 0, list(agent.child.last_lines)


def restore(agent: Peer) -> None:
    """Whatever was stopped, set and described, the agent drives the robot again."""
    assert agent.set(**adjustable(AgentParams)) == ""
    for name, on in (("estop", False), ("enable", True), ("learn", False)):
        assert agent.call(SetBool, name, data=on).success
    with Rogue(agent) as rogue:
        rogue.describe()
        agent.ping()
    for _ in range(2):  # by the first states it finds out that what it heard before was of no simulation
        agent.plant.reset()
        agent.ping()
    agent.plant.wait(lambda: agent.plant.tick.status.truncated, "an episode that the agent drives")


def test_nothing_is_left_out(agent: Peer) -> None:
    require_all(agent, TOPICS, REQUESTS)


@pytest.mark.parametrize("name", VOLLEYS)
def test_messages_do_no_harm(agent: Peer, name: str) -> None:
    with Rogue(agent) as rogue:

        def send(drawn) -> None:
            assert agent.plant.call(Trigger, "reset").success
            rogue.fire(drawn)

        besiege(agent, VOLLEYS[name], send)
    restore(agent)


@pytest.mark.parametrize("name", REQUESTS)
def test_requests_do_no_harm(agent: Peer, name: str) -> None:
    def send(request) -> None:
        assert agent.plant.call(Trigger, "reset").success
        agent.call(REQUESTS[name].kind, name, request)
        assert len(learning_process(agent.child)) <= 1  # one that saves its state is not overtaken by the next

    besiege(agent, REQUESTS[name].requests, send)
    restore(agent)
