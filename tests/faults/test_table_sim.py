"""What the simulation does about each fault: the rows of docs/faults.md that are its own."""

import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters
from rled_msgs_py.processes import Child, program
from rled_msgs_py.topics import JOINT_DELTA
from rled_sim.commands import Code
from std_srvs.srv import SetBool, Trigger

from .plant import Plant

Take = Callable[[str, str, float, list[str]], None]
PERIOD = 20_000_000
ENDLESS = ["--robot", "planar", "--targets-per-episode", "0", "--max-steps", "0"]
LIMITS = [
    "--joint-margin=0.1",
    "--velocity-share=0.8",  # 4.8 rad/s, 0.096 rad in a period
    "--acceleration=200",  # 0.08 rad more in a period
    "--workspace=-1 -1 0 0.7 1 1",
    "--keep-out=sphere 0.5455 0.298 0.1 0.1",  # where the tip comes to when the shoulder turns by 0.5 rad
]


@pytest.fixture(scope="module")
def plant(ros_domain: int) -> Iterator[Plant]:
    """The planar arm in lockstep, with every limit but collisions on."""
    with Plant(*ENDLESS, *LIMITS) as plant:
        yield plant


def changed(**fields: Any) -> Callable[[Plant], Any]:
    """A valid command but for these fields."""

    def message(plant: Plant) -> Any:
        made = plant.command((0.01, 0.01))
        for name, value in fields.items():
            setattr(made, name, value)
        return made

    return message


def stamped(seconds: int, nanoseconds: int) -> Callable[[Plant], Any]:
    def message(plant: Plant) -> Any:
        made = plant.command((0.01, 0.01))
        made.header.stamp.sec, made.header.stamp.nanosec = seconds, nanoseconds
        return made

    return message


REFUSED = {
    "a displacement that is NaN": (changed(position=[float("nan"), 0.0]), Code.UNREADABLE),
    "a displacement that is infinite": (changed(position=[0.0, float("-inf")]), Code.UNREADABLE),
    "fewer displacements than names": (changed(position=[0.01]), Code.UNREADABLE),
    "more displacements than names": (changed(position=[0.01] * 9), Code.UNREADABLE),
    "no names": (changed(name=[], position=[]), Code.UNREADABLE),
    "a joint named twice": (changed(name=["elbow", "elbow"]), Code.UNREADABLE),
    "a joint with an empty name": (changed(name=["shoulder", ""]), Code.UNREADABLE),
    "a joint missing": (changed(name=["elbow"], position=[0.01]), Code.WRONG_NAMES),
    "a joint of another robot": (changed(name=["shoulder", "panda_joint1"]), Code.WRONG_NAMES),
    "a stamp before zero": (stamped(-1, 0), Code.UNREADABLE),
    "a stamp with 2 s of nanoseconds": (stamped(0, 2_000_000_000), Code.UNREADABLE),
    "a displacement larger than Δq_max": (changed(position=[0.101, 0.0]), Code.TOO_LARGE),
    "a displacement of 1e308 rad": (changed(position=[0.0, 1e308]), Code.TOO_LARGE),
    "an answer to an older state": (lambda plant: plant.command((0.02, 0.0), plant.tick.stamp - PERIOD), Code.STALE),
    "an answer to a state yet to come": (
        lambda plant: plant.command((0.01, 0.01), plant.tick.stamp + PERIOD),
        Code.FUTURE,
    ),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_a_bad_command_is_refused_and_the_simulation_waits_on(plant: Plant, row: Take, fault: str) -> None:
    message, code = REFUSED[fault]
    seen, since = plant.reported(code), len(plant.ticks) - 1
    took = plant.measure(plant.send(message(plant)), seen, fault)
    assert len(plant.ticks) == since + 1
    plant.step((0.01, 0.01))
    decision = f"refused ({code.name.lower()}); it waits for a valid answer"
    row(fault, decision, took, plant.outside_limits(since))


def test_the_command_taken_last_changes_nothing_when_it_comes_again(plant: Plant, row: Take) -> None:
    since, answer = len(plant.ticks) - 1, plant.command((0.01, 0.0))
    plant.step((0.01, 0.0))
    valid = plant.command((0.0, 0.01))
    stale = int(plant.health[-1].values["commands_stale"])

    def act() -> None:
        plant.output.publish(answer)
        plant.output.publish(valid)

    took = plant.measure(act, plant.moved_on(), "a tick")
    plant.wait(lambda: plant.health[-1].stamp >= plant.tick.stamp, "a report")
    assert int(plant.health[-1].values["commands_stale"]) == stale
    assert len(plant.ticks) == since + 3
    decision = "it changes nothing; the valid command behind it is carried out"
    row("the command taken last, retransmitted", decision, took, plant.outside_limits(since))


def test_bytes_that_are_no_message_are_dropped(plant: Plant, row: Take) -> None:
    since, valid = len(plant.ticks) - 1, plant.command((0.01, 0.0))

    def act() -> None:
        plant.output.publish(b"\x00\x01\x00\x00\xff\xff\xff\x7f")
        plant.output.publish(valid)

    took = plant.measure(act, plant.moved_on(), "a tick")
    decision = "dropped; the valid command behind them is carried out"
    row("bytes that are no message", decision, took, plant.outside_limits(since))


def test_another_order_of_the_joints_is_put_right(plant: Plant, row: Take) -> None:
    since, before = len(plant.ticks) - 1, plant.tick
    message = changed(name=["elbow", "shoulder"], position=[0.02, -0.03])(plant)
    took = plant.measure(plant.send(message), plant.moved_on(), "a tick")
    np.testing.assert_allclose(plant.tick.joints.position - before.joints.position, (-0.03, 0.02), atol=1e-12)
    row("joints in another order", "carried out, by name", took, plant.outside_limits(since))


BEYOND = {
    "an angle nearer to the joint limit than the margin": ((-0.9, 2.88), (0.0, 0.03), Code.JOINT_RANGE),
    "a joint rate above its limit": ((-0.9, 1.8), (0.098, 0.0), Code.VELOCITY),
    "a joint that speeds up too much": ((-0.9, 1.8), (0.0, 0.09), Code.ACCELERATION),
    "the end effector on its way out of the workspace": ((-0.9, 1.6), (0.0, -0.07), Code.WORKSPACE),
    "the end effector on its way into a keep-out zone": ((-0.6, 1.8), (0.07, 0.0), Code.KEEP_OUT),
}


def refuse_motion(plant: Plant, row: Take, fault: str, delta: Sequence[float], code: Code) -> None:
    since, before = len(plant.ticks) - 1, plant.tick
    took = plant.measure(plant.send(plant.command(delta)), plant.moved_on(), "a tick")
    assert plant.tick.status.refused == code.name.lower()
    assert plant.tick.status.step == before.status.step + 1
    np.testing.assert_array_equal(plant.tick.joints.position, before.joints.position)
    decision = f"refused ({code.name.lower()}); the robot stays, the step counts"
    row(fault, decision, took, plant.outside_limits(since))


@pytest.mark.parametrize("fault", BEYOND)
def test_a_motion_beyond_a_limit_is_a_step_without_motion(plant: Plant, row: Take, fault: str) -> None:
    q, delta, code = BEYOND[fault]
    plant.reset()
    plant.go(*q)
    plant.step((0.0, 0.0))
    refuse_motion(plant, row, fault, delta, code)


PURPOSE = {
    "commands lost": ({"command_loss": 1.0}, "the robot stays, the step counts", -0.9),
    "commands one step late": ({"control_delay": 1}, "the robot stays until they come", -0.9),
    "states lost": ({"observation_loss": 1.0}, "the one before is given again, under the stamp of the next", -0.9),
    "states one step late": ({"observation_delay": 1}, "the one before is given, under the stamp of the next", -0.9),
    "the shoulder's encoder dead": ({"hidden": "shoulder"}, "the middle of its range is given", 0.0),
}


@pytest.mark.parametrize("fault", PURPOSE)
def test_faults_on_purpose_do_not_stop_lockstep(plant: Plant, row: Take, fault: str) -> None:
    settings, decision, shoulder = PURPOSE[fault]
    sound = {"command_loss": 0.0, "control_delay": 0, "observation_loss": 0.0, "observation_delay": 0, "hidden": ""}
    plant.set(**settings)
    plant.reset()
    since, before = len(plant.ticks), plant.tick
    took = plant.measure(plant.send(plant.command((0.01, 0.01))), plant.moved_on(), "a tick")
    assert plant.tick.status.step == before.status.step + 1
    assert plant.tick.joints.position[0] == pytest.approx(shoulder)
    plant.set(**sound)
    plant.reset()
    row(f"on purpose: {fault}", decision, took, plant.outside_limits(since))


def test_noise_of_the_actuators_stays_within_the_limits(plant: Plant, row: Take) -> None:
    plant.set(actuator_noise=2.0)
    plant.reset()
    since = len(plant.ticks) - 1
    took = plant.measure(plant.send(plant.command((0.0, 0.0))), plant.moved_on(), "a tick")
    for _ in range(50):
        plant.step((0.0, 0.0))
    assert any(tick.status.refused for tick in plant.ticks[since:])
    plant.set(actuator_noise=0.0)
    plant.reset()
    decision = "clipped to Δq_max, then judged by the limits"
    row("on purpose: actuator noise of 2 Δq_max", decision, took, plant.outside_limits(since))


def test_changes_that_are_not_allowed_are_refused(plant: Plant, row: Take) -> None:
    def asked(**wanted: Any) -> tuple[float, str]:
        answers: list[str] = []
        took = plant.measure(lambda: answers.append(plant.set(**wanted)), lambda: answers, "an answer")
        return took, answers[0]

    since = len(plant.ticks) - 1
    for fault, wanted, said in (
        ("a parameter out of its range", {"command_timeout": -1.0}, "range"),
        ("another robot by parameter while it runs", {"robot": "panda"}, "read-only"),
    ):
        took, reason = asked(**wanted)
        assert said in reason
        row(fault, "refused, with the reason", took, plant.outside_limits(since))
    bad = ParameterMessage(name="seed", value=ParameterValue(type=255))
    took = plant.measure(lambda: plant.call(SetParameters, "set_parameters", parameters=[bad]), lambda: True, "")
    plant.step((0.01, 0.0))
    row("a parameter of a type that does not exist", "not set; it goes on", took, plant.outside_limits(since))


def test_the_emergency_stop_refuses_everything(plant: Plant, row: Take) -> None:
    since, before = len(plant.ticks) - 1, plant.tick
    assert plant.call(SetBool, "estop", data=True).success
    took = plant.measure(plant.send(plant.command((0.05, 0.0))), plant.reported(Code.STOPPED), "a report")
    row("a command under the emergency stop", "refused (stopped)", took, plant.outside_limits(since))
    took = plant.measure(lambda: plant.call(Trigger, "reset"), lambda: True, "")
    assert not plant.call(Trigger, "reset").success
    assert plant.tick is before
    row("a reset under the emergency stop", "refused, with the reason", took, plant.outside_limits(since))
    assert plant.call(SetBool, "estop", data=False).success
    plant.wait(lambda: plant.tick is not before, "a tick to answer")
    plant.step((0.01, 0.0))


def test_a_second_simulation_does_not_begin(plant: Plant, row: Take) -> None:
    second: list[Any] = []
    took = plant.measure(
        lambda: second.append(plant.children.start([*program("rled_sim", "sim_node"), "--discovery-wait", "20"])),
        lambda: second[0].exit_code is not None,
        "its end",
    )
    assert second[0].exit_code == 2
    row("a second simulation in the graph", "the second ends before it publishes", took, [])


def test_no_answer_is_waited_for(plant: Plant, row: Take) -> None:
    begun = len(plant.health)
    since, before = len(plant.ticks) - 1, plant.tick
    took = plant.measure(lambda: None, lambda: len(plant.health) > begun + 1, "two reports")
    assert plant.tick is before
    plant.step((0.01, 0.0))
    row("no answer, lockstep", "it waits, and goes on reporting", took, plant.outside_limits(since))


@pytest.fixture(scope="module")
def ticking(plant: Plant) -> Iterator[Plant]:
    """The planar arm in real time, in the graph that the one in lockstep leaves."""
    plant.children.end(plant.simulation)
    with Plant(*ENDLESS, "--mode", "real_time") as ticking:
        yield ticking


LATE = {
    "an answer to a state three periods old": 3,
    "another answer to the same state": 0,
}


@pytest.mark.parametrize("fault", LATE)
def test_a_late_command_is_a_hold(ticking: Plant, row: Take, fault: str) -> None:
    seen, since = ticking.reported(Code.STALE), len(ticking.ticks) - 1
    stamp = ticking.tick.stamp - LATE[fault] * PERIOD
    message = ticking.command((0.05, 0.0), stamp)
    if not LATE[fault]:
        before = ticking.tick.status.step
        ticking.output.publish(ticking.command((0.04, 0.0), stamp))
        ticking.wait(lambda: ticking.tick.status.step > before, "a step")
    took = ticking.measure(ticking.send(message), seen, fault)
    before = ticking.tick
    ticking.wait(lambda: ticking.tick.stamp > before.stamp + 2 * PERIOD, "ticks")
    np.testing.assert_array_equal(ticking.tick.joints.position, before.joints.position)
    row(f"{fault}, real time", "refused (stale); the robot holds", took, ticking.outside_limits(since))


def still(ticking: Plant) -> bool:
    """Five ticks alike: an operator that a busy machine keeps waiting misses fewer."""
    return len({tick.joints.position.tobytes() for tick in ticking.ticks[-5:]}) == 1


def readers(ticking: Plant) -> set[bytes]:
    """Who listens to commands, or did before he was killed."""
    found = ticking.node.get_subscriptions_info_by_topic(JOINT_DELTA.name)
    return {bytes(each.endpoint_gid) for each in found}


@pytest.fixture
def driven(ticking: Plant) -> Child:
    """An operator of its own process who keeps the arm moving."""
    operator = ticking.children.start([sys.executable, str(Path(__file__).with_name("operator_that_swings.py"))])
    ticking.wait(lambda: not still(ticking), "motion")
    return operator


def test_an_operator_that_dies_leaves_the_robot_holding(ticking: Plant, driven: Child, row: Take) -> None:
    since = len(ticking.ticks) - 1

    def kill() -> None:
        driven.process.kill()
        driven.process.wait()

    took = ticking.measure(kill, lambda: still(ticking), "a hold")
    held = ticking.tick
    ticking.wait(lambda: ticking.tick.stamp > held.stamp + 10 * PERIOD, "ticks")
    np.testing.assert_array_equal(ticking.tick.joints.position, held.joints.position)
    row(
        "the operator killed while it moves the robot",
        "the robot holds, five ticks alike",
        took,
        ticking.outside_limits(since),
    )


def test_the_emergency_stop_ends_motion(ticking: Plant, driven: Child, row: Take) -> None:
    since = len(ticking.ticks) - 1
    stop = lambda: ticking.call(SetBool, "estop", data=True)  # noqa: E731
    took = ticking.measure(stop, lambda: still(ticking), "a hold")
    held = ticking.tick
    ticking.wait(lambda: ticking.tick.stamp > held.stamp + 10 * PERIOD, "ticks")
    np.testing.assert_array_equal(ticking.tick.joints.position, held.joints.position)
    ticking.call(SetBool, "estop", data=False)
    ticking.wait(lambda: not still(ticking), "motion again")
    ticking.children.end(driven)
    row(
        "the emergency stop while the robot moves",
        "the robot holds until it is released, five ticks alike",
        took,
        ticking.outside_limits(since),
    )


def test_a_killed_simulation_begins_anew(ticking: Plant, row: Take) -> None:
    """Stands last: the simulation is another one then."""
    gone = readers(ticking)
    os.kill(ticking.simulation.process.pid, signal.SIGKILL)
    ticking.simulation.process.wait()
    ticking.children.end(ticking.simulation)
    start = lambda: ticking.start("--robot", "planar")  # noqa: E731
    took = ticking.measure(start, lambda: ticking.tick.stamp == 0, "the first tick")
    begun = len(ticking.ticks) - 1
    ticking.wait(lambda: bool(readers(ticking) - gone), "its reader")
    ticking.step((0.01, 0.0))
    row(
        "the simulation killed and started again",
        "it begins at its first tick; who listens goes on",
        took,
        ticking.outside_limits(begun),
    )


COLLISIONS = {
    "a link on its way into the floor": ((0.0, 0.54, 0.0, -2.2, 0.0, 2.0, 0.785), 1, 0.04, Code.CONTACT),
    "a link on its way into another": ((0.0, -0.3, 0.0, -2.2, 0.0, 0.16, 0.785), 5, -0.04, Code.SELF_COLLISION),
}


@pytest.mark.parametrize("fault", COLLISIONS)
def test_a_collision_is_a_step_without_motion(ticking: Plant, row: Take, fault: str) -> None:
    q, joint, change, code = COLLISIONS[fault]
    ticking.children.end()
    with Plant("--robot", "panda", "--collisions", "--targets-per-episode", "0", "--max-steps", "0") as panda:
        panda.go(*q)
        refuse_motion(panda, row, fault, [change if each == joint else 0.0 for each in range(7)], code)


def test_a_command_after_the_end_is_refused(ticking: Plant, row: Take) -> None:
    ticking.children.end()
    with Plant("--robot", "planar", "--max-steps", "1", "--no-auto-reset") as plant:
        plant.step((0.01, 0.0))
        since = len(plant.ticks) - 1
        seen = plant.reported(Code.EPISODE_OVER)
        took = plant.measure(plant.send(plant.command((0.01, 0.0))), seen, "a report")
        row("a command after the end of the episode", "refused (episode_over)", took, plant.outside_limits(since))
