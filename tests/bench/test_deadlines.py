"""Control at 100 Hz in real time, with and without learning beside it. RLED_BENCH_SECONDS=600 makes it ten minutes."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.node import fresh_context, spin_until, subscribe
from rled_msgs_py.processes import Children, program
from rled_msgs_py.topics import JOINT_DELTA, TASK_STATUS, Qos
from std_srvs.srv import SetBool

from .weights import untrained

PERIOD = 0.01
SECONDS = float(os.environ.get("RLED_BENCH_SECONDS", "40"))
WARM_UP = 5.0
DEEP = Qos(depth=1000)
"""Answers that wait when the watch itself is held up; with the contract's queue of one they would count as missed."""


class Watch:
    """Notes when states and answers arrive."""

    def __init__(self) -> None:
        self._context = fresh_context()
        self._node = Node("watch", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.states: dict[int, float] = {}
        self.answers: dict[int, float] = {}
        subscribe(self._node, TASK_STATUS, self._on_status)
        subscribe(self._node, replace(JOINT_DELTA, qos=DEEP), self._on_delta)

    def _on_delta(self, command) -> None:
        self.answers.setdefault(command.stamp, time.monotonic())

    def _on_status(self, status) -> None:
        if not (status.terminated or status.truncated):
            self.states[status.stamp] = time.monotonic()

    def spin(self, seconds: float) -> None:
        """Watch for a while."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._executor.spin_once(timeout_sec=0.1)

    def wait(self, done: Callable[[], bool], what: str) -> None:
        """Watch until a predicate holds."""
        spin_until(self._executor, done, 60.0, what)

    def learn(self, on: bool) -> None:
        """Switch learning on or off."""
        client = self._node.create_client(SetBool, "agent_node/learn")
        self.wait(client.service_is_ready, "the agent")
        answer = client.call_async(SetBool.Request(data=on))
        self.wait(answer.done, "an answer")
        assert answer.result().success

    def loops(self, seconds: float) -> np.ndarray:
        """From a state to its answer (s), one for each state; infinite where none came."""
        self.spin(WARM_UP)
        self.states.clear()
        self.spin(seconds)
        stamps = sorted(self.states)[:-10]
        return np.array([self.answers.get(stamp, np.inf) - self.states[stamp] for stamp in stamps])

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def watch(tmp_path: Path) -> Iterator[Watch]:
    """A graph that is driven through the gate at 100 Hz."""
    agent = untrained(tmp_path / "agent", 0.1)
    with Children() as children, closing(Watch()) as watch:
        sim = ["--robot", "panda", "--mode", "real_time", "--period", str(PERIOD)]
        children.start([*program("rled_sim", "sim_node"), *sim])
        options = ["--expert", agent, "--agent", agent, "--threshold", 1e9, "--learning-state", tmp_path / "state"]
        children.start([*program("rled_agent", "agent_node"), *map(str, options)])
        watch.wait(lambda: len(watch.answers) > 100, "answers")
        yield watch


def test_learning_beside_control_costs_it_nothing(figure, watch):
    without = watch.loops(SECONDS / 4)
    watch.learn(True)
    with_learning = watch.loops(SECONDS)
    p99 = [np.quantile(loops[np.isfinite(loops)], 0.99) for loops in (without, with_learning)]
    missed = float(np.mean(with_learning > PERIOD))
    figure("control_loop_p99_ms", float(p99[0] * 1e3))
    figure("p99_learning_ratio", float(p99[1] / p99[0]))
    figure("deadline_miss_share", missed)
    assert p99[1] / p99[0] <= 2.0
    assert missed <= 1e-3
