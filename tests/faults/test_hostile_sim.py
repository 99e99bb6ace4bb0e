"""Hostile messages and requests for sim_node: it must not crash, not move outside the limits, not grow."""

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import strategies as st
from rled_msgs_py.topics import JOINT_DELTA, TARGET_REQUEST
from rled_sim.sim_params import SimParams
from std_srvs.srv import SetBool, Trigger

from .hostile import DOUBLES, attacks
from .hostile_requests import adjustable, requests_of
from .plant import Plant
from .siege import COUNT, Rogue, besiege, require_all, volleys
from .valid_messages import VALID

LIMITS = ["--joint-margin", "0.1", "--velocity-share", "0.9", "--keep-out", "sphere 0 0 0.1 0.2"]
MODES = {"lockstep": [], "limits": LIMITS, "real_time": ["--mode", "real_time", "--transition", "motors"]}
NEAR = st.one_of(DOUBLES, st.floats(-0.11, 0.11))
VOLLEYS = volleys([TARGET_REQUEST])
REQUESTS = requests_of(SimParams, {"pause": SetBool, "estop": SetBool, "reset": Trigger})


def displaced(delta: tuple[float, float]) -> Any:
    valid = VALID[JOINT_DELTA]
    return type(valid)(header=valid.header, name=valid.name, position=list(delta))


DELTAS = st.one_of(attacks(VALID[JOINT_DELTA]), st.tuples(NEAR, NEAR).map(displaced))


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
    """Whatever was stopped and set, a valid command moves the robot again."""
    own = {name: value for name, value in adjustable(SimParams).items() if name != "seed"}
    assert plant.set(**own | {"command_timeout": 10.0}) == ""
    for name in ("estop", "pause"):
        assert plant.call(SetBool, name, data=False).success
    plant.reset()
    step = plant.tick.status.step
    plant.output.publish(plant.command((0.01, 0.01)))
    plant.wait(lambda: plant.tick.status.step > step, "an answer to a valid command")
    assert not [each.message for each in plant.health if "simulations in this graph" in each.message]


def test_nothing_is_left_out(plant: Plant) -> None:
    require_all(plant.sim, [JOINT_DELTA, TARGET_REQUEST], REQUESTS)


def test_messages_on_joint_delta_do_no_harm(plant: Plant) -> None:
    before, readable = heard(plant), [0]
    with Rogue(plant.sim) as rogue:

        def send(message: Any) -> None:
            readable[0] += not isinstance(message, bytes)
            rogue.fire((0, [(JOINT_DELTA, message)]))

        assert besiege(plant.sim, DELTAS, send) >= COUNT
    restore(plant)
    assert heard(plant) - before > 0.9 * readable[0]


def test_messages_on_target_request_do_no_harm(plant: Plant) -> None:
    with Rogue(plant.sim) as rogue:
        assert besiege(plant.sim, VOLLEYS[TARGET_REQUEST.name], rogue.fire) >= COUNT
    restore(plant)


@pytest.mark.parametrize("name", REQUESTS)
def test_requests_do_no_harm(plant: Plant, name: str) -> None:
    besiege(plant.sim, REQUESTS[name].requests, lambda request: plant.sim.call(REQUESTS[name].kind, name, request))
    restore(plant)
