"""Hostile messages and requests for sim_node: it must not crash, not move unlawfully, not grow.

``RLED_HOSTILE`` says how many of each kind in each mode; ``make hostile`` sends 20,000 messages in all.
"""

import os
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rled_msgs_py.convert import to_msg
from rled_msgs_py.params import parameters_of
from rled_msgs_py.records import DeltaCommand
from rled_sim.sim_params import SimParams
from std_srvs.srv import SetBool, Trigger

from .hostile import DOUBLES, TEXTS, attacks, hostile
from .plant import Plant

COUNT = int(os.environ.get("RLED_HOSTILE", "50"))
LIMITS = ["--joint-margin", "0.1", "--velocity-share", "0.9", "--keep-out", "sphere 0 0 0.1 0.2"]
MODES = {"lockstep": [], "limits": LIMITS, "real_time": ["--mode", "real_time", "--transition", "motors"]}
GROWTH = 2.0
"""Memory that may come on top between the first fifth of the messages and the last (MB): allocators breathe."""

hostility = settings(
    max_examples=COUNT,
    phases=[Phase.generate],  # a simulation that is gone cannot be asked again
    suppress_health_check=list(HealthCheck),
)

LAWFUL = to_msg(DeltaCommand(12_345, ("shoulder", "elbow"), [0.05, -0.05]))
"""Its stamp stands for that of the newest tick, which is known when it is sent."""


def displaced(delta: tuple[float, float]) -> Any:
    message = to_msg(DeltaCommand(12_345, ("shoulder", "elbow"), [0.0, 0.0]))
    message.position = list(delta)
    return message


NEAR = st.one_of(DOUBLES, st.floats(-0.11, 0.11))
DELTAS = st.one_of(attacks(LAWFUL), st.tuples(NEAR, NEAR).map(displaced))

NAMES = st.one_of(st.sampled_from([each.name for each in parameters_of(SimParams)] + ["use_sim_time"]), TEXTS)
VALUES = st.one_of(
    hostile(ParameterValue),
    st.builds(lambda kind, value: setattr(value, "type", kind) or value, st.integers(0, 9), hostile(ParameterValue)),
)
PARAMETERS = st.lists(
    st.builds(lambda name, value: ParameterMessage(name=name, value=value), NAMES, VALUES), max_size=4
)
REQUESTS = {
    "pause": hostile(SetBool.Request),
    "estop": hostile(SetBool.Request),
    "reset": hostile(Trigger.Request),
    "set_parameters": PARAMETERS.map(lambda each: SetParameters.Request(parameters=each)),
    "set_parameters_atomically": PARAMETERS.map(lambda each: SetParametersAtomically.Request(parameters=each)),
    "get_parameters": st.lists(NAMES, max_size=5).map(lambda each: GetParameters.Request(names=each)),
    "get_parameter_types": st.lists(NAMES, max_size=5).map(lambda each: GetParameterTypes.Request(names=each)),
    "describe_parameters": st.lists(NAMES, max_size=5).map(lambda each: DescribeParameters.Request(names=each)),
    "list_parameters": hostile(ListParameters.Request),
}
KINDS = {
    "pause": SetBool,
    "estop": SetBool,
    "reset": Trigger,
    "set_parameters": SetParameters,
    "set_parameters_atomically": SetParametersAtomically,
    "get_parameters": GetParameters,
    "get_parameter_types": GetParameterTypes,
    "describe_parameters": DescribeParameters,
    "list_parameters": ListParameters,
}


@pytest.fixture(scope="module", params=MODES)
def plant(request: pytest.FixtureRequest, ros_domain: int) -> Iterator[Plant]:
    with Plant("--robot", "planar", *MODES[request.param]) as plant:
        yield plant


def heard(plant: Plant) -> int:
    """Commands that the simulation has counted, refused ones too."""
    begun = len(plant.health)
    plant.wait(lambda: len(plant.health) > begun, "a report")
    plant.wait(lambda: len(plant.health) > begun + 1, "a report that began after it was asked for")
    counts = plant.health[-1].values
    return sum(int(value) for name, value in counts.items() if name.startswith("commands_"))


def restore(plant: Plant) -> None:
    """Whatever was stopped and set, a lawful command moves the robot again."""
    own = [each for each in parameters_of(SimParams) if not each.spec.read_only and each.name != "seed"]
    assert plant.set(**{each.name: each.default for each in own} | {"command_timeout": 10.0}) == ""
    for name in ("estop", "pause"):
        assert plant.call(SetBool, name, data=False).success
    plant.reset()
    step = plant.tick.status.step
    plant.output.publish(plant.command((0.01, 0.01)))
    plant.wait(lambda: plant.tick.status.step > step, "an answer to a lawful command")


def besiege(plant: Plant, strategy: st.SearchStrategy[Any], send: Callable[[Any], None]) -> int:
    """Send messages of a strategy; see that nothing unlawful comes of it. How many were sent."""
    sent, since, memory = [0], len(plant.ticks) - 1, []

    @hostility
    @given(strategy)
    def attack(message: Any) -> None:
        send(message)
        sent[0] += 1
        memory.append(plant.resident())
        assert plant.simulation.exit_code is None

    while sent[0] < COUNT:  # where there are but few different ones, again
        attack()
    assert not [each.message for each in plant.health if "simulations in this graph" in each.message]
    assert plant.unlawful(since) == []
    assert memory[-1] - memory[len(memory) // 5] < GROWTH
    restore(plant)
    return sent[0]


def test_messages_on_joint_delta_do_no_harm(plant: Plant) -> None:
    before = heard(plant)
    readable = [0]

    def send(message: Any) -> None:
        if not isinstance(message, bytes):
            readable[0] += 1
            if message.header.stamp == LAWFUL.header.stamp:
                message.header.stamp = plant.command((0.0, 0.0)).header.stamp
        plant.output.publish(message)
        plant.call(GetParameters, "get_parameters", names=[])  # as a pause, or the queue of one keeps the last only

    assert besiege(plant, DELTAS, send) >= COUNT
    assert heard(plant) - before > 0.9 * readable[0]


@pytest.mark.parametrize("name", REQUESTS)
def test_requests_do_no_harm(plant: Plant, name: str) -> None:
    besiege(plant, REQUESTS[name], lambda request: plant.call(KINDS[name], name, request))
