"""What every node shares: topics, parameters, start and end."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.params import param
from rled_msgs_py.records import DeltaCommand, PoseSample
from rled_msgs_py.ros.convert import qos_profile, to_msg
from rled_msgs_py.ros.node import advertise, declare, fresh_context, spin_until, subscribe, subscribe_ticks
from rled_msgs_py.topics import EE_POSE, JOINT_DELTA, Topic
from sensor_msgs.msg import JointState

from rled_msgs_py import messages

from .samples import NAMES, same, tick


@dataclass(frozen=True)
class Params:
    rate: float = param(50.0, "ticks a second", low=1.0, high=1000.0)
    count: int = param(7, "a number", low=1, high=9)
    robot: str = param("panda", "the robot", choices=("panda", "planar"))
    gui: bool = param(False, "show a window", read_only=True)


class Graph:
    """Two nodes of one context, spun by hand."""

    def __init__(self) -> None:
        self.context = fresh_context()
        self.executor = SingleThreadedExecutor(context=self.context)
        self.talker, self.listener = self.node("talker"), self.node("listener")

    def node(self, name: str, **options) -> Node:
        node = Node(name, context=self.context, **options)
        self.executor.add_node(node)
        return node

    def spin_until(self, done) -> None:
        spin_until(self.executor, done, 20.0, "the test")

    def publisher(self, topic: Topic, subscription: Subscription) -> Publisher:
        """A publisher that the subscription knows, and that knows it: each end finds the other in its own time."""
        publisher = advertise(self.talker, topic)
        self.spin_until(lambda: publisher.get_subscription_count() and subscription.get_publisher_count())
        return publisher


@pytest.fixture
def graph() -> Iterator[Graph]:
    graph = Graph()
    yield graph
    graph.executor.shutdown()
    graph.context.try_shutdown()


def test_records_travel(graph):
    received, command = [], DeltaCommand(7, NAMES, [0.01, -0.02])
    subscription = subscribe(graph.listener, JOINT_DELTA, received.append)
    graph.publisher(JOINT_DELTA, subscription).publish(to_msg(command))
    graph.spin_until(lambda: received)
    assert same(received[0], command)


def test_bytes_received_equal_those_of_a_bag(graph):
    received, command = [], DeltaCommand(7, ("abc", "abd"), [0.01, -0.02])
    subscription = graph.listener.create_subscription(
        JointState, JOINT_DELTA.name, received.append, qos_profile(JOINT_DELTA.qos), raw=True
    )
    graph.publisher(JOINT_DELTA, subscription).publish(to_msg(command))
    graph.spin_until(lambda: received)
    without_padding = bytearray(received[0])
    without_padding[17:20] = bytes(3)  # after the empty frame; what lies there is not defined
    assert without_padding == messages.encode(JOINT_DELTA, command)


def test_a_bad_message_is_dropped_and_the_next_is_taken(graph):
    received, refused = [], []
    subscription = subscribe(graph.listener, JOINT_DELTA, received.append, refused.append)
    publisher = graph.publisher(JOINT_DELTA, subscription)
    publisher.publish(JointState(name=["a"], position=[float("nan")]))
    graph.spin_until(lambda: refused)
    publisher.publish(JointState(name=["a"], position=[0.5]))
    graph.spin_until(lambda: received)
    assert [record.delta.tolist() for record in received] == [[0.5]]
    assert isinstance(refused[0], ContractError)


def test_what_a_callback_finds_to_break_the_contract_is_refused(graph):
    refused = []

    def callback(command: DeltaCommand) -> None:
        command.ordered(("b",))

    subscription = subscribe(graph.listener, JOINT_DELTA, callback, refused.append)
    publisher = graph.publisher(JOINT_DELTA, subscription)
    publisher.publish(JointState(name=["a"], position=[0.5]))
    graph.spin_until(lambda: refused)
    assert "differs in a, b" in str(refused[0])


def test_a_late_joiner_receives_the_waiting_tick(graph):
    for topic, record in tick(3)[:4]:
        advertise(graph.talker, topic).publish(to_msg(record))
    ticks = []
    subscribe_ticks(graph.listener, ticks.append)
    graph.spin_until(lambda: ticks)
    assert [each.stamp for each in ticks] == [tick(3)[0][1].stamp]
    assert all(same(part, record) for part, (_, record) in zip(ticks[0], tick(3), strict=False))


def test_a_command_is_not_kept_for_a_late_joiner(graph):
    received = []
    publisher = advertise(graph.talker, JOINT_DELTA)
    publisher.publish(to_msg(DeltaCommand(1, NAMES, [0.0, 0.0])))
    subscription = subscribe(graph.listener, JOINT_DELTA, received.append)
    graph.spin_until(lambda: publisher.get_subscription_count() and subscription.get_publisher_count())
    publisher.publish(to_msg(DeltaCommand(2, NAMES, [0.0, 0.0])))
    graph.spin_until(lambda: received)
    assert [record.stamp for record in received] == [2]


def test_parameters_are_declared_with_their_descriptors(graph):
    assert declare(graph.listener, Params) == Params()
    rate = graph.listener.describe_parameter("rate")
    assert rate.description == "ticks a second"
    assert (rate.floating_point_range[0].from_value, rate.floating_point_range[0].to_value) == (1.0, 1000.0)
    assert graph.listener.describe_parameter("count").integer_range[0].to_value == 9
    assert graph.listener.describe_parameter("robot").additional_constraints == "one of: panda, planar"
    assert graph.listener.describe_parameter("gui").read_only


def test_a_given_parameter_replaces_the_default(graph):
    node = graph.node("other", parameter_overrides=[Parameter("rate", value=25.0), Parameter("gui", value=True)])
    assert declare(node, Params) == Params(rate=25.0, gui=True)


@pytest.mark.parametrize(
    ("name", "value", "offender"),
    [("rate", 0.0, "rate"), ("rate", 25, "rate"), ("robot", "hexapod", "robot is 'hexapod'"), ("count", 10, "count")],
)
def test_a_bad_parameter_at_the_start_is_refused(graph, name, value, offender):
    node = graph.node("other", parameter_overrides=[Parameter(name, value=value)])
    with pytest.raises(ContractError, match=offender):
        declare(node, Params)


def test_an_accepted_change_is_applied_and_a_bad_one_is_not(graph):
    seen = []
    declare(graph.listener, Params, seen.append)
    assert graph.listener.set_parameters([Parameter("rate", value=20.0)])[0].successful
    assert seen == [Params(rate=20.0)]
    result = graph.listener.set_parameters([Parameter("robot", value="hexapod")])[0]
    assert not result.successful
    assert "accepted: panda, planar" in result.reason
    assert not graph.listener.set_parameters([Parameter("rate", value=0.0)])[0].successful
    assert not graph.listener.set_parameters([Parameter("gui", value=True)])[0].successful
    assert seen == [Params(rate=20.0)]


def test_waiting_in_vain_ends_with_an_error_that_says_for_what(graph):
    with pytest.raises(RledError, match=r"waited 0\.2 s for a miracle"):
        spin_until(graph.executor, lambda: False, 0.2, "a miracle")


PROGRAM = """
import time
from dataclasses import dataclass
from rclpy.node import Node
from rled_msgs_py.ros.node import declare, run_node
from rled_msgs_py.params import param

@dataclass(frozen=True)
class Params:
    rate: float = param(50.0, "ticks a second", low=1.0, high=1000.0)

class Example(Node):
    def __init__(self, **options):
        super().__init__("example", **options)
        print(declare(self, Params), flush=True)

    def destroy_node(self):
        print("saving", flush=True)
        time.sleep(0.5)
        print("saved", flush=True)
        super().destroy_node()

run_node(Example, Params, "example", "An example.")
"""


def start(*arguments, **environment):
    command = [sys.executable, "-c", PROGRAM, *arguments]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, env=os.environ | environment, **pipes)


def test_a_node_ends_cleanly_on_a_signal():
    for number in [signal.SIGINT, signal.SIGTERM]:
        with start("--rate", "25") as process:
            assert process.stdout.readline() == "Params(rate=25.0)\n"
            process.send_signal(number)
            _, errors = process.communicate(timeout=30)
        assert process.returncode == 0
        assert "Traceback" not in errors


def test_a_node_that_is_asked_twice_saves_to_the_end():
    with start() as process:
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "saving\n"
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        output, errors = process.communicate(timeout=30)
    assert (process.returncode, output, errors) == (0, "saved\n", "")


def test_a_bad_start_is_one_line_and_exit_2():
    for arguments, environment, offender in [
        (["--rate", "0"], {}, "rate is 0.0; accepted: 1.0 to 1000.0"),
        (["--speed", "1"], {}, "--speed"),
        (["--ros-args", "-p", "rate:=0.5"], {}, "rate"),
        (["--ros-args", "-p", "rate:=fast"], {}, "rate"),
        ([], {"ROS_DOMAIN_ID": "500"}, "ROS_DOMAIN_ID is '500'; accepted: 0 to 101"),
    ]:
        with start(*arguments, **environment) as process:
            output, errors = process.communicate(timeout=30)
        assert process.returncode == 2
        assert output == ""
        assert len(errors.splitlines()) == 1
        assert offender in errors


def test_pose_keeps_its_frame(graph):
    received = []
    subscribe(graph.listener, EE_POSE, received.append)
    pose = PoseSample(1, "world", np.ones(3))
    advertise(graph.talker, EE_POSE).publish(to_msg(pose))
    graph.spin_until(lambda: received)
    assert same(received[0], pose)
