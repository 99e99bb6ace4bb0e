"""The scripted operator as a process of its own, beside a simulation in another."""

import signal
import subprocess
from collections.abc import Iterator

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.processes import program
from rled_msgs_py.ros.node import fresh_context, spin_until
from rled_msgs_py.topics import JOINT_STATES, Topic

WAIT_TIMEOUT = 60.0


def start(package: str, name: str, *arguments: str) -> "subprocess.Popen[str]":
    command = [*program(package, name), *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def operate(*arguments: str) -> tuple[int, str]:
    """Exit code and stderr of an operator that ends itself."""
    operator = start("rled_teleop", "teleop_scripted", *arguments)
    _, err = operator.communicate(timeout=WAIT_TIMEOUT)
    return operator.returncode, err


def await_subscriber_of(topic: Topic) -> None:
    """Return when a node subscribes to a topic, so that it is built and handles signals."""
    context = fresh_context()
    node = Node("onlooker", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        spin_until(
            executor, lambda: node.count_subscribers(topic.name) > 0, WAIT_TIMEOUT, f"a subscriber of {topic.name}"
        )
    finally:
        node.destroy_node()
        context.try_shutdown()


@pytest.fixture(scope="module")
def simulation(ros_domain: int) -> Iterator[None]:
    """An endless planar task in lockstep."""
    arguments = ("--robot", "planar", "--targets-per-episode", "0", "--max-steps", "0", "--discovery-wait", "0.2")
    process = start("rled_sim", "sim_node", *arguments)
    yield
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=WAIT_TIMEOUT)


@pytest.mark.usefixtures("simulation")
def test_an_operator_ends_itself_and_the_next_one_goes_on_from_the_waiting_tick() -> None:
    for _ in range(2):
        code, err = operate("--points", "40", "--trajectories", "3")
        assert code == 0, err
        assert "40 of 40 points marked" in err
        assert "3 of 3 targets reached" in err


@pytest.mark.usefixtures("simulation")
def test_more_points_than_the_curve_has_are_refused_in_one_line() -> None:
    code, err = operate("--points", "401")
    said = err.splitlines()[-1]
    assert (code, said) == (2, "error: 401 points of the target curve; accepted: 1 to 400; mark fewer points")


def test_a_parameter_out_of_range_is_refused_in_one_line() -> None:
    code, err = operate("--tremor", "1.5")
    assert (code, err) == (2, "error: tremor is 1.5; accepted: 0.0 to 1.0\n")


@pytest.mark.usefixtures("simulation")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_operator_that_waits_for_subscribers_ends_on_a_signal(number: signal.Signals) -> None:
    operator = start("rled_teleop", "teleop_scripted", "--wait-for-subscribers", "7")
    await_subscriber_of(JOINT_STATES)
    with pytest.raises(subprocess.TimeoutExpired):
        operator.communicate(timeout=1.0)  # it goes on waiting
    operator.send_signal(number)
    _, err = operator.communicate(timeout=WAIT_TIMEOUT)
    assert operator.returncode == 0
    assert all("waiting for" in line for line in err.splitlines())
