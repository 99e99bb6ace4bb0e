"""A command reaches a reader that is matched late, and each reader once."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.records import DeltaCommand
from rled_msgs_py.ros.command_output import CommandOutput
from rled_msgs_py.ros.node import fresh_context, spin_until, subscribe
from rled_msgs_py.topics import JOINT_DELTA, Qos

WAIT_TIMEOUT = 20.0


class Robot:
    """A node that is driven, and one that hears what it is told, spun by hand."""

    def __init__(self) -> None:
        self.context = fresh_context()
        self.executor = SingleThreadedExecutor(context=self.context)
        self.driver, self.simulation = (Node(name, context=self.context) for name in ("driver", "simulation"))
        for node in (self.driver, self.simulation):
            self.executor.add_node(node)
        self.heard: list[int] = []
        self.output = CommandOutput(self.driver)

    def listen(self) -> None:
        topic = replace(JOINT_DELTA, qos=Qos(depth=10))
        self.ear = subscribe(self.simulation, topic, lambda command: self.heard.append(command.stamp))

    def say(self, stamp: int) -> None:
        self.output.publish(DeltaCommand(stamp, ("a",), (0.0,)))

    def spin_until(self, done: Callable[[], bool]) -> None:
        spin_until(self.executor, done, WAIT_TIMEOUT, "the test")


@pytest.fixture
def robot(ros_domain: int) -> Iterator[Robot]:
    robot = Robot()
    yield robot
    robot.executor.shutdown()
    for node in (robot.driver, robot.simulation):
        node.destroy_node()
    robot.context.try_shutdown()


def await_match(robot: Robot) -> None:
    """The writer knows the reader; the node that writes has not been told so yet, since nothing spins it."""
    deadline = time.monotonic() + WAIT_TIMEOUT
    while not robot.output.publisher.get_subscription_count():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def test_a_command_that_waits_reaches_a_reader_that_comes_later(robot):
    robot.say(1)
    robot.listen()
    robot.spin_until(lambda: robot.heard == [1])
    robot.say(2)
    robot.spin_until(lambda: 2 in robot.heard)
    assert robot.heard == [1, 2]


def test_a_command_withdrawn_does_not(robot):
    robot.say(1)
    robot.output.withdraw()
    robot.listen()
    await_match(robot)
    robot.spin_until(lambda: bool(robot.simulation.count_publishers(JOINT_DELTA.name)))
    robot.say(2)
    robot.spin_until(lambda: bool(robot.heard))
    assert robot.heard == [2]


def test_a_command_said_to_a_known_reader_is_not_said_again_when_the_node_is_told_of_it(robot):
    robot.listen()
    await_match(robot)
    robot.say(1)
    robot.spin_until(lambda: bool(robot.heard))
    robot.say(2)
    robot.spin_until(lambda: 2 in robot.heard)
    assert robot.heard == [1, 2]


@pytest.mark.parametrize("told", [True, False], ids=["one event each", "one event of both"])
def test_a_command_that_waits_reaches_who_comes_in_the_place_of_another(robot, told):
    count = robot.output.publisher.get_subscription_count
    robot.listen()
    await_match(robot)
    robot.say(1)
    robot.spin_until(lambda: bool(robot.heard))
    robot.simulation.destroy_subscription(robot.ear)
    while told and count():
        robot.executor.spin_once(timeout_sec=0.01)
    robot.listen()
    robot.spin_until(lambda: robot.heard == [1, 1])
