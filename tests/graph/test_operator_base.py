"""How an operator answers: at whose pace, and which ticks, before a simulation that does as the test says."""

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rled_msgs_py.messages import encode
from rled_msgs_py.records import DeltaCommand, Text
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.ros.liveliness import advertise_with_deadline
from rled_msgs_py.ros.node import advertise, fresh_context, spin_until, subscribe
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import HUMAN_JOINT_DELTA, JOINT_DELTA, JOINT_STATES, ROBOT_DESCRIPTION, TASK_DESCRIPTION
from rled_sim.robots import ROBOTS
from rled_sim.sim_params import SimParams, simulation_of
from rled_sim.ticks import tick_of
from rled_teleop.nodes.operator_base import OperatorBase

PERIOD = 0.5
"""Of the simulation (s): long beside what a busy machine needs for an answer, short to wait for."""
MOTION = np.array([0.01, -0.02])


class Stage:
    """An operator, and the simulation that it answers, in one process."""

    def __init__(self, *, in_time: bool) -> None:
        self.command: np.ndarray | None = MOTION
        self.heard: dict[int, tuple[float, DeltaCommand]] = {}
        self._context = fresh_context()
        self.node, self._sim = (Node(name, context=self._context) for name in ("operator", "sim"))
        self._executor = EventsExecutor(context=self._context)
        self.base = OperatorBase(self.node, False, lambda jog, q: self.command)
        self.base.start_timer(self.base.poll)
        simulation = simulation_of(SimParams(robot="planar", period=PERIOD))
        simulation.reset(np.random.default_rng(0))
        self._tick = tick_of(simulation, 0, 0, 0.0)
        promised = advertise_with_deadline(self._sim, JOINT_STATES, PERIOD, lambda count: None) if in_time else None
        self._states = [promised or advertise(self._sim, JOINT_STATES)]
        self._states += [advertise(self._sim, topic) for topic in STATE_TOPICS[1:]]
        described = simulation.task.description.to_json(), ROBOTS["planar"].description
        texts = dict(zip((TASK_DESCRIPTION, ROBOT_DESCRIPTION), described, strict=True))
        self._latched = [advertise(self._sim, topic) for topic in texts]
        for output, text in zip(self._latched, texts.values(), strict=True):
            output.publish(to_msg(Text(text)))
        for topic in (JOINT_DELTA, HUMAN_JOINT_DELTA):
            subscribe(self._sim, topic, self._on_delta)
        for node in (self.node, self._sim):
            self._executor.add_node(node)
        matched = [*self._states, self.base._output.publisher]
        self.wait(lambda: self.base.jog is not None and all(each.get_subscription_count() for each in matched))

    def _on_delta(self, command: DeltaCommand) -> None:
        self.heard[command.stamp] = time.monotonic(), command

    def wait(self, done) -> None:
        spin_until(self._executor, done, 60.0, "what should happen")

    def say(self, number: int) -> int:
        """Publish a tick; its stamp."""
        stamp = number * round(PERIOD * 1e9)
        for topic, output, record in zip(STATE_TOPICS, self._states, self._tick, strict=True):
            output.publish(encode(topic, replace(record, stamp=stamp)))
        return stamp

    def answer_to(self, number: int) -> tuple[float, DeltaCommand]:
        """When a tick was answered, and how."""
        stamp = self.say(number)
        self.wait(lambda: stamp in self.heard)
        return self.heard[stamp]

    def close(self) -> None:
        self._executor.shutdown()
        for node in (self.node, self._sim):
            node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def lockstep() -> Iterator[Stage]:
    with closing(Stage(in_time=False)) as stage:
        yield stage


@pytest.fixture
def in_time() -> Iterator[Stage]:
    with closing(Stage(in_time=True)) as stage:
        yield stage


def test_in_lockstep_the_operator_keeps_the_period(lockstep):
    times = [lockstep.answer_to(number)[0] for number in range(1, 6)]
    assert times[-1] - times[0] >= 3.4 * PERIOD  # four periods, the first of which may be half as long


def test_a_simulation_that_keeps_time_is_answered_at_once(in_time):
    times = [in_time.answer_to(number)[0] for number in range(1, 21)]
    assert times[-1] - times[0] < 19 * PERIOD / 2


def test_a_tick_left_to_the_agent_is_answered_once_there_is_none(lockstep):
    lockstep.base.stand(True)
    lockstep.command = None
    stamp = lockstep.say(1)
    lockstep.wait(lambda: lockstep.base.tick is not None and lockstep.base._is_answered)
    assert not lockstep.heard
    lockstep.base.stand(False)
    lockstep.wait(lambda: stamp in lockstep.heard)
    assert lockstep.heard[stamp][1].delta.tolist() == [0.0, 0.0]


def test_beside_an_agent_only_motion_is_said_and_publishers_are_kept(lockstep):
    lockstep.base.stand(True)
    beside = len(list(lockstep.node.publishers))
    assert lockstep.answer_to(1)[1].delta.tolist() == MOTION.tolist()
    for number in range(2, 5):
        lockstep.base.stand(bool(number % 2))
        assert lockstep.answer_to(number)[1].delta.tolist() == MOTION.tolist()
    assert len(list(lockstep.node.publishers)) == beside
