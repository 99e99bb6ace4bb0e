"""From a state to its answer, between two processes: the agent node against a bare rclpy echo in the same run."""

import math
import statistics
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.messages import encode
from rled_msgs_py.processes import Children, program
from rled_msgs_py.records import Text
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.ros.node import advertise, fresh_context, spin_until
from rled_msgs_py.tick import STATE_TOPICS, Tick
from rled_msgs_py.topics import JOINT_DELTA, ROBOT_DESCRIPTION, TASK_DESCRIPTION
from rled_sim.robots import ROBOTS
from rled_sim.sim_params import SimParams, simulation_of
from rled_sim.ticks import tick_of
from sensor_msgs.msg import JointState

from .conftest import wanted
from .weights import DESCRIPTION, untrained

ROUNDS, LOOPS, WARM_UP = 41, 50, 100
ECHO = """
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
rclpy.init()
node = Node("echo")
output = node.create_publisher(JointState, "echo/joint_delta", 10)
node.create_subscription(JointState, "echo/joint_states", output.publish, 10)
rclpy.spin(node)
"""


class Prober:
    """Publishes a state and waits for what answers it."""

    def __init__(self) -> None:
        self._context = fresh_context()
        self._node = Node("prober", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        simulation = simulation_of(SimParams())
        simulation.reset(np.random.default_rng(0))
        self._tick = tick_of(simulation, 0, 0, 0.0)
        self._question = to_msg(self._tick.joints)
        self._states = [advertise(self._node, topic) for topic in STATE_TOPICS]
        self._echo = self._node.create_publisher(JointState, "echo/joint_states", 10)
        self._answer = self._stamp = 0
        for name in (JOINT_DELTA.name, "echo/joint_delta"):
            self._node.create_subscription(JointState, name, self._on_answer, 10)
        texts = {ROBOT_DESCRIPTION: ROBOTS["panda"].description, TASK_DESCRIPTION: DESCRIPTION.to_json()}
        self._latched = [advertise(self._node, topic) for topic in texts]
        for output, text in zip(self._latched, texts.values(), strict=True):
            output.publish(to_msg(Text(text)))
        simulation.plant.close()

    def _on_answer(self, message: JointState) -> None:
        self._answer = message.header.stamp.sec

    def ask_echo(self) -> None:
        """Publish one message that is sent back."""
        self._echo.publish(self._question)

    def ask_agent(self) -> None:
        """Publish a state on the four topics of the contract, as sim_node does."""
        for topic, output, record in zip(STATE_TOPICS, self._states, self._tick, strict=True):
            output.publish(encode(topic, record))

    def _go_on(self) -> None:
        """The next state, and the next message for the echo."""
        self._stamp += 1
        self._question.header.stamp.sec = self._stamp
        self._tick = Tick(*(replace(record, stamp=self._stamp * 10**9) for record in self._tick))

    def time(self, ask: Callable[[], None]) -> float:
        """Seconds from a question to its answer."""
        self._go_on()
        started = time.perf_counter()
        ask()
        spin_until(self._executor, lambda: self._answer == self._stamp, 60.0, "an answer")
        return time.perf_counter() - started

    def await_answers(self, ask: Callable[[], None]) -> None:
        """Ask until somebody answers, and some more."""
        begun, asked = self._answer, -math.inf
        while self._answer == begun:
            self._executor.spin_once(timeout_sec=0.05)
            if time.monotonic() - asked > 1.0:
                self._go_on()
                ask()
                asked = time.monotonic()
        for _ in range(WARM_UP):
            self.time(ask)

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()


def loop_against_echo(agent: Path, expert: Path) -> tuple[float, float]:
    """Medians of the agent's loop and of the echo's (s), measured by turns."""
    times = {"agent": [], "echo": []}
    with Children() as children, closing(Prober()) as prober:
        asks = {"agent": prober.ask_agent, "echo": prober.ask_echo}
        children.start([sys.executable, "-c", ECHO])
        command = [*program("rled_agent", "agent_node"), "--expert", expert, "--agent", agent, "--threshold", 1e9]
        children.start(list(map(str, command)))
        for ask in asks.values():
            prober.await_answers(ask)
        for _ in range(ROUNDS):
            for name, ask in asks.items():
                times[name].append(statistics.median(prober.time(ask) for _ in range(LOOPS)))
    return statistics.median(times["agent"]), statistics.median(times["echo"])


def test_the_actor_answers_in_the_time_of_one_and_a_half_echoes(figure, tmp_path):
    plain = untrained(tmp_path / "plain", 0.0)
    agent, echo = loop_against_echo(plain, plain)
    figure("loop_echo_ms", echo * 1e3)
    figure("loop_vs_echo_actor", agent / echo)
    wanted(agent / echo <= 1.6, "loop_vs_echo_actor of 1.6 at most")


def test_the_gate_answers_in_the_time_of_two_and_a_half_echoes(figure, tmp_path):
    dropout = untrained(tmp_path / "dropout", 0.1)
    agent, echo = loop_against_echo(dropout, dropout)
    figure("loop_vs_echo_gate", agent / echo)
    wanted(agent / echo <= 2.5, "loop_vs_echo_gate of 2.5 at most")
