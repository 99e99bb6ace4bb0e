"""Hostile messages and requests for every operator, beside a robot in real time that it drives."""

import itertools
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import strategies as st
from rled_msgs_py.processes import Child, program
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import (
    DIAGNOSTICS,
    EPISODE_EVENTS,
    JOINT_DELTA,
    MARKERS,
    ROBOT_DESCRIPTION,
    SAFETY_GATE,
    TASK_DESCRIPTION,
    Topic,
)
from rled_teleop.nodes.teleop_gamepad import GamepadParams
from rled_teleop.nodes.teleop_keyboard import KeyboardParams
from rled_teleop.nodes.teleop_kinesthetic import KinestheticParams
from rled_teleop.nodes.teleop_scripted import ScriptedParams
from rled_teleop.web.params import WebParams
from sensor_msgs.msg import JointState, Joy

from ..graph.programs import ENDLESS
from ..graph.terminal import Terminal
from ..web.conftest import free_port
from .hostile import TEXTS
from .hostile_requests import adjustable, requests_of
from .plant import Peer, Plant
from .siege import Rogue, Witness, besiege, moves, require_all, volleys
from .valid_messages import DEVICE, JOINTS, JOY, Q

DRIVING = (*STATE_TOPICS, TASK_DESCRIPTION, ROBOT_DESCRIPTION)
WATCHING = (*DRIVING, JOINT_DELTA, SAFETY_GATE, DIAGNOSTICS, EPISODE_EVENTS, MARKERS)
SWAY = itertools.cycle([1.0] * 30 + [-1.0] * 30)
"""To one side and to the other: somewhere on the way the robot can go."""
KEYS = st.one_of(TEXTS, st.sampled_from(["\x1b[", "\x1b[999A", "\x1bO", "w" * 50, "123456789", "bnkxm"])).map(
    lambda text: "".join(key for key in text if key not in "Q\x03")
)
"""Anything that can be typed but quit and Ctrl-C; escape sequences by themselves and cut short."""


class Operator(NamedTuple):
    """An operator node: its parameters, what it listens to, and how it is started."""

    params: type
    topics: tuple[Topic, ...]
    options: tuple[str, ...] = ()


OPERATORS: Mapping[str, Operator] = {
    "teleop_scripted": Operator(ScriptedParams, DRIVING, ("--trajectories", "1000000")),
    "teleop_keyboard": Operator(KeyboardParams, DRIVING),
    "teleop_gamepad": Operator(GamepadParams, (*DRIVING, JOY)),
    "teleop_kinesthetic": Operator(KinestheticParams, (*DRIVING, DEVICE)),
    "teleop_web": Operator(WebParams, WATCHING, ("--role", "alone", "--port", str(free_port()))),
}
VOLLEYS = {name: volleys(each.topics) for name, each in OPERATORS.items()}
REQUESTS = {name: requests_of(each.params, {}) for name, each in OPERATORS.items()}


class Person:
    """Somebody who drives by an operator of any kind, until the robot has moved."""

    def __init__(self, peer: Peer, terminal: Terminal | None) -> None:
        self.peer, self.terminal = peer, terminal

    def drive(self) -> None:
        """Whatever was said before, the robot is driven."""
        plant, since, witness = self.peer.plant, len(self.peer.plant.ticks), Witness(self.peer.plant)
        with Rogue(self.peer) as rogue:
            rogue.describe()

            def driven() -> bool:
                assert self.peer.child.exit_code is None, list(self.peer.child.last_lines)
                self.act(rogue)
                # nobody has opened the page, so it answers and holds
                return witness.commands() > 5 if self.peer.name == "teleop_web" else moves(plant, since)

            plant.wait(driven, "motion")
        witness.leave()

    def act(self, rogue: Rogue) -> None:
        """Do what a person does who drives; the rogue lends the devices' topics."""
        side = next(SWAY)
        if self.terminal is not None:
            self.type("1." if side > 0 else "1,")
        elif self.peer.name == "teleop_gamepad":
            rogue.publish(JOY, Joy(axes=[0.0, 0.0, 0.0, side], buttons=[0, 0, 0, 0, 1]))
        elif self.peer.name == "teleop_kinesthetic":
            rogue.publish(DEVICE, JointState(name=JOINTS, position=[q + side for q in Q]))

    def type(self, keys: str) -> None:
        """Press keys, and see the screen, which would wait for it otherwise."""
        assert self.terminal is not None
        self.terminal.press(keys)
        self.terminal.look(0.0)


@pytest.fixture(scope="module")
def plant(ros_domain: int) -> Iterator[Plant]:
    with Plant("--robot", "planar", "--mode", "real_time", "--marker-rate", "0", *ENDLESS) as plant:
        yield plant


@contextmanager
def at_work(plant: Plant, name: str, folder: Path) -> Iterator[Person]:
    """An operator that drives; it must end cleanly too."""
    if name == "teleop_keyboard":
        with (folder / "errors").open("w+") as errors:
            with closing(Terminal(errors=errors)) as terminal:
                yield Person(Peer(plant, name, Child(name, terminal.process)), terminal)
                terminal.press("Q")
                assert terminal.end() == 0
            errors.seek(0)
            assert "Traceback" not in errors.read()
        return
    child = plant.children.start([*program("rled_teleop", name), *OPERATORS[name].options], echo=False)
    if name == "teleop_web":
        plant.wait(lambda: any("page:" in line for line in child.last_lines), "the page")
    peer = Peer(plant, name, child)
    peer.settle()
    yield Person(peer, None)
    plant.children.end(child)
    assert child.exit_code == 0, list(child.last_lines)


class Crew:
    """One operator at a time beside a plant."""

    def __init__(self, plant: Plant, folder: Path, stack: ExitStack) -> None:
        self._plant, self._folder, self._stack = plant, folder, stack
        self._person: Person | None = None

    def take(self, name: str) -> Person:
        """This one; the other goes."""
        if self._person is None or self._person.peer.name != name:
            self._stack.close()
            self._person = self._stack.enter_context(at_work(self._plant, name, self._folder))
            self._person.drive()
            require_all(self._person.peer, OPERATORS[name].topics, REQUESTS[name])
        return self._person


@pytest.fixture(scope="module")
def crew(plant: Plant, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Crew]:
    with ExitStack() as stack:
        yield Crew(plant, tmp_path_factory.mktemp("operators"), stack)


def attacks_on(name: str) -> list[str]:
    """What is done to an operator."""
    return [*VOLLEYS[name], *REQUESTS[name], *(["keys"] if name == "teleop_keyboard" else [])]


ALL = [pytest.param(name, attack, id=f"{name}-{attack}") for name in OPERATORS for attack in attacks_on(name)]


@pytest.mark.parametrize(("name", "attack"), ALL)
def test_no_attack_does_harm(crew: Crew, name: str, attack: str) -> None:
    person = crew.take(name)
    peer = person.peer
    with Rogue(peer) as rogue:
        if attack == "keys":
            besiege(peer, KEYS, person.type)
        elif attack in VOLLEYS[name]:
            besiege(peer, VOLLEYS[name][attack], lambda volley: (person.act(rogue), rogue.fire(volley)))
        else:
            kind, requests = REQUESTS[name][attack]
            besiege(peer, requests, lambda request: (person.act(rogue), peer.call(kind, attack, request)))
    if own := adjustable(OPERATORS[name].params):
        assert peer.set(**own) == ""
    person.drive()
