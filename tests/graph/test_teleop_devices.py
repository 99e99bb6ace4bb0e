"""Gamepad and kinesthetic operators as processes, driven by messages of simulated devices."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rled_msgs_py.records import JointSample
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.ros.node import fresh_context, spin_until, subscribe
from rled_msgs_py.topics import HUMAN_JOINT_DELTA, JOINT_DELTA, JOINT_STATES
from rled_teleop.operators.gamepad import Layout
from sensor_msgs.msg import JointState, Joy

from .programs import WAIT_TIMEOUT, planar_simulation, running

LAYOUT = Layout()


class World:
    """Sees the robot; has a gamepad and another arm."""

    def __init__(self, domain: int) -> None:
        self._context = fresh_context(domain)
        self.node = rclpy.create_node("person", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.states: list[JointSample] = []
        self.deltas: list[Any] = []
        self.human: list[Any] = []
        subscribe(self.node, JOINT_STATES, self.states.append)
        subscribe(self.node, JOINT_DELTA, self.deltas.append)
        subscribe(self.node, HUMAN_JOINT_DELTA, self.human.append)
        self._joy = self.node.create_publisher(Joy, "joy", 10)
        self._device = self.node.create_publisher(JointState, "leader/joint_states", 10)

    @property
    def q(self) -> np.ndarray:
        return self.states[-1].position

    def stick(self, axes: dict[int, float], *buttons: int) -> None:
        deflections = [axes.get(k, 0.0) for k in range(8)]
        self._joy.publish(Joy(axes=deflections, buttons=[int(k in buttons) for k in range(11)]))

    def move_device(self, **angles: float) -> None:
        sample = JointSample(0, tuple(angles), np.array(list(angles.values())), np.zeros(len(angles)))
        self._device.publish(to_msg(sample))

    def await_that(self, condition: Callable[[], object], what: str, doing: Callable[[], None] = lambda: None) -> None:
        """Spin until a condition holds, doing something 20 times a second."""
        last = [0.0]

        def done() -> bool:
            if time.monotonic() - last[0] > 0.05:
                last[0] = time.monotonic()
                doing()
            return bool(condition())

        spin_until(self._executor, done, WAIT_TIMEOUT, what)

    def rests(self, doing: Callable[[], None] = lambda: None) -> bool:
        """Whether the robot stays where it is for 0.4 s of simulation, after the last motion has been seen."""
        began = self.states[-1].stamp
        self.await_that(lambda: self.states[-1].stamp > began + 6e8, "the last motion", doing)
        q, began = self.q, self.states[-1].stamp
        self.await_that(lambda: self.states[-1].stamp > began + 4e8, "time to pass", doing)
        return bool((self.q == q).all())

    def close(self) -> None:
        self.node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def world(ros_domain: int) -> Iterator[World]:
    with planar_simulation("real_time"), closing(World(ros_domain)) as one:
        one.await_that(lambda: one.states, "the robot")
        yield one


def test_a_gamepad_turns_the_joint_only_with_the_deadman_button(world: World) -> None:
    with running("rled_teleop", "teleop_gamepad"):
        start = world.q
        world.await_that(lambda: world.deltas, "the operator", lambda: world.stick({LAYOUT.turn: 1.0}))
        assert world.rests(lambda: world.stick({LAYOUT.turn: 1.0}))
        np.testing.assert_array_equal(world.q, start)
        held = lambda: world.stick({LAYOUT.turn: 1.0}, LAYOUT.deadman)  # noqa: E731
        world.await_that(lambda: world.q[0] > start[0] + 0.1, "motion", held)
        assert world.q[1] == start[1]
        assert world.rests(), "a silent gamepad lets go"


def test_beside_an_agent_only_motion_is_published(world: World) -> None:
    with running("rled_teleop", "teleop_gamepad", "--beside-agent"):
        held = lambda: world.stick({LAYOUT.x: -1.0}, LAYOUT.deadman)  # noqa: E731
        world.await_that(lambda: len(world.human) > 3, "motion", held)
        assert all(np.abs(each.delta).max() > 0 for each in world.human)
        assert not world.deltas


def test_the_robot_follows_a_device_through_its_mapping_and_then_holds(world: World) -> None:
    mapping = "{shoulder: {name: a, scale: -1.0}, elbow: {name: b, scale: 2.0, offset: 1.0}}"
    options = ("--device-topic", "leader/joint_states", "--mapping", mapping)
    with running("rled_teleop", "teleop_kinesthetic", *options):

        def arrived() -> bool:
            return bool(np.allclose(world.q, [-0.5, 1.6], atol=1e-9))

        world.await_that(arrived, "the robot to follow", lambda: world.move_device(b=0.3, a=0.5, c=7.0))
        assert world.rests()
        assert max(np.abs(each.delta).max() for each in world.deltas) <= 0.1 + 1e-12


def test_a_wrong_mapping_ends_in_one_line(world: World) -> None:
    with running("rled_teleop", "teleop_kinesthetic", "--mapping", "{nose: {name: a}}") as operator:
        assert operator.wait(timeout=WAIT_TIMEOUT) == 2
        assert operator.stderr is not None
        line = operator.stderr.read()
    assert "the mapping names nose; accepted: shoulder, elbow" in line
    assert "Traceback" not in line
