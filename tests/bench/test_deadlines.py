"""Control in real time, with and without learning beside it. RLED_BENCH_SECONDS=600 makes it ten minutes."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rled_msgs_py.processes import Children, program
from rled_msgs_py.ros.node import fresh_context, spin_until, subscribe
from rled_msgs_py.topics import JOINT_DELTA, TASK_STATUS, Qos
from std_srvs.srv import SetBool

from .conftest import wanted
from .weights import untrained

PERIOD = 0.01
"""Of control at 100 Hz (s)."""
FAST = 0.002
"""Of control at 500 Hz (s)."""
SECONDS = float(os.environ.get("RLED_BENCH_SECONDS", "40"))
WARM_UP = 5.0
DEEP = Qos(depth=1000)
"""Answers that wait when the watch itself is held up; with the contract's queue of one they would count as missed."""


class Watch:
    """Notes when states and answers arrive."""

    def __init__(self) -> None:
        self._context = fresh_context()
        self._node = Node("watch", context=self._context)
        self._executor = EventsExecutor(context=self._context)
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


@contextmanager
def driven_at(period: float, folder: Path) -> Iterator[Watch]:
    """A graph that is driven through the gate in real time, and a watch on it."""
    agent = untrained(folder / "agent", 0.1)
    with Children() as children, closing(Watch()) as watch:
        sim = ["--robot", "panda", "--mode", "real_time", "--period", str(period)]
        children.start([*program("rled_sim", "sim_node"), *sim])
        options = ["--expert", agent, "--agent", agent, "--threshold", 1e9, "--learning-state", folder / "state"]
        children.start([*program("rled_agent", "agent_node"), *map(str, options)])
        watch.wait(lambda: len(watch.answers) > 100, "answers")
        yield watch


def percentile_99(loops: np.ndarray) -> float:
    """Of the answers that came (s)."""
    return float(np.quantile(loops[np.isfinite(loops)], 0.99))


def test_learning_beside_control_costs_it_nothing(figure, tmp_path):
    with driven_at(PERIOD, tmp_path) as watch:
        without = watch.loops(SECONDS / 4)
        watch.learn(True)
        with_learning = watch.loops(SECONDS)
    ratio = percentile_99(with_learning) / percentile_99(without)
    missed = float(np.mean(with_learning > PERIOD))
    figure("control_loop_p99_ms", percentile_99(without) * 1e3)
    figure("p99_learning_ratio", ratio)
    figure("deadline_miss_share", missed)
    wanted(ratio <= 2.0, "p99_learning_ratio of 2 at most")
    wanted(missed <= 1e-3, "deadline_miss_share of 0.001 at most")


def test_at_500_hz_most_states_are_answered_in_time(figure, tmp_path):
    with driven_at(FAST, tmp_path) as watch:
        without = watch.loops(SECONDS / 4)
        watch.learn(True)
        with_learning = watch.loops(SECONDS / 4)
    figure("control_500hz_p99_ms", percentile_99(without) * 1e3)
    figure("control_500hz_miss_share", float(np.mean(without > FAST)))
    figure("control_500hz_learning_miss_share", float(np.mean(with_learning > FAST)))
    wanted(bool(np.median(without) < FAST), "a median answer within 2 ms")
