"""The page beside an agent that drives: curves, threshold, taking over and handing back, learning and saving."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rled_agent.nn.policy import load_policy
from rled_msgs_py.processes import Children, program
from rled_msgs_py.records import Actor, GateCode

from ..graph.team import actor_like
from .conftest import take_the_wheel
from .socket_visitor import SocketVisitor


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("learning")


@pytest.fixture(scope="module")
def agent(planar_expert: Path, folder: Path) -> Path:
    return actor_like(planar_expert, folder / "actor.safetensors")


@pytest.fixture(scope="module")
def address(ros_domain: int, planar_expert: Path, agent: Path, folder: Path, serve: Any) -> Iterator[str]:
    sim = ["--robot", "planar", "--mode", "real_time", "--targets-per-episode", "2", "--max-steps", "60"]
    options = ["--expert", planar_expert, "--agent", agent, "--threshold", 1e6, "--measure", "iqr"]
    options += ["--learning-state", folder / "learning" / "state.safetensors", "--learning-priority", "low"]
    with Children() as children:
        children.start([*program("rled_sim", "sim_node"), *sim])
        children.start([*program("rled_agent", "agent_node"), *map(str, options)])
        with serve() as address:
            yield address


@pytest.fixture
def me(address: str, watcher: Any) -> Iterator[SocketVisitor]:
    """A visitor who drives; the agent moves the robot meanwhile."""
    visitor = SocketVisitor(address)
    watcher.await_that(lambda: "driven by agent_node" in visitor.text(), "the agent")
    take_the_wheel(visitor)
    yield visitor
    visitor.close()


@pytest.fixture
def acts(watcher: Any) -> Callable[[Actor], None]:
    """Waits for ten decisions in a row by one actor."""

    def wait(actor: Actor) -> None:
        begun = len(watcher.decisions)

        def done() -> bool:
            newest = watcher.decisions[begun:][-10:]
            return len(newest) == 10 and all(each.actor is actor for each in newest)

        watcher.await_that(done, f"ten decisions by {actor.value}")

    return wait


def test_curves_and_the_gates_words_are_shown(me: SocketVisitor, watcher: Any) -> None:
    watcher.await_that(lambda: "**agent** acts" in me.text() and "u = " in me.text(), "the gate's words")
    for title in ("uncertainty u", "return", "targets reached", "share of demonstrated actions"):
        watcher.await_that(lambda title=title: any(each.startswith(title) for each in me.plots()), title)


def test_the_threshold_is_set_from_the_page(me: SocketVisitor, watcher: Any, acts: Callable[[Actor], None]) -> None:
    acts(Actor.AGENT)
    me.enter("ξ threshold", 0.0)
    acts(Actor.EXPERT)
    assert watcher.decisions[-1].threshold == 0.0
    me.enter("ξ threshold", 1e6)
    acts(Actor.AGENT)
    watcher.await_that(lambda: "threshold is 1000000.0" in me.text(), "the answer")


def test_episodes_are_given_to_the_expert_from_the_page(me: SocketVisitor, watcher: Any) -> None:
    def drivers() -> set[tuple[Actor, GateCode]]:
        newest = watcher.decisions[-1].episode
        return {(each.actor, each.code) for each in watcher.decisions if each.episode == newest}

    me.enter("Φ", 1.0)
    watcher.await_that(lambda: drivers() == {(Actor.EXPERT, GateCode.DRAWN)}, "an episode of the expert's")
    me.enter("Φ", 0.0)
    watcher.await_that(lambda: drivers() == {(Actor.AGENT, GateCode.SURE)}, "an episode of the agent's")


def test_a_person_takes_over_holds_drives_and_hands_back(
    me: SocketVisitor, watcher: Any, acts: Callable[[Actor], None]
) -> None:
    acts(Actor.AGENT)
    me.click("Take over")
    acts(Actor.HUMAN)
    watcher.await_that(lambda: "Hand back" in me.labels(), "the button")
    watcher.await_that(watcher.rests, "the robot to hold")
    before = watcher.tool[1]
    with me.holding("y −"):
        watcher.await_that(lambda: watcher.tool[1] < before - 0.01, "motion by the person")
    watcher.await_that(watcher.rests, "the robot to hold")
    me.click("Hand back")
    acts(Actor.AGENT)
    watcher.await_that(watcher.moves, "motion by the agent")


def test_a_held_button_takes_over_for_as_long_as_it_is_held(
    me: SocketVisitor, watcher: Any, acts: Callable[[Actor], None]
) -> None:
    with me.holding("x −"):
        acts(Actor.HUMAN)
    acts(Actor.AGENT)


def test_learning_is_switched_and_saved_from_the_page(me: SocketVisitor, watcher: Any, folder: Path) -> None:
    def says(text: str) -> None:
        watcher.await_that(lambda: text in me.text(), text)

    me.click("Learn")
    says("learn: learning")
    says("transitions learned from")
    begun = time.time()
    me.click("Save checkpoint")
    says("save: saved into")
    policy = folder / "learning" / "policy.safetensors"
    assert policy.stat().st_mtime >= begun - 1.0
    assert load_policy(policy).task.robot == "planar"
    me.click("Stop learning")
    says("rest: not learning")
    watcher.await_that((folder / "learning" / "state.safetensors").exists, "the state of learning")
