"""A simulated planar robot in a process of its own, and a node that hears all that is said."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.processes import Children, program
from rled_msgs_py.records import DeltaCommand, GateDecision, Health
from rled_msgs_py.ros.node import fresh_context, spin_until, subscribe, subscribe_ticks
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import DIAGNOSTICS, JOINT_DELTA, SAFETY_GATE, Qos

WAIT_TIMEOUT = 90.0
DEEP = 100_000
"""Samples that the observer's readers keep: it may be slower than the graph."""


class Observer:
    """Hears everything that the simulation and the agent of one namespace say."""

    def __init__(self, namespace: str = "") -> None:
        self.context = fresh_context()
        self.node = Node("observer", context=self.context, namespace=namespace)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.ticks: list[Tick] = []
        self.deltas: list[DeltaCommand] = []
        self.decisions: list[GateDecision] = []
        self.health: dict[str, Health] = {}
        subscribe_ticks(self.node, self.ticks.append, DEEP)
        for topic, heard in ((JOINT_DELTA, self.deltas), (SAFETY_GATE, self.decisions)):
            subscribe(self.node, replace(topic, qos=Qos(depth=DEEP)), heard.append)
        subscribe(self.node, DIAGNOSTICS, lambda health: self.health.update({health.name: health}))

    def wait(self, done: Callable[[], bool], what: str) -> None:
        spin_until(self.executor, done, WAIT_TIMEOUT, what)

    def call(self, kind: type, name: str, **request: Any) -> Any:
        """The answer of a service."""
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready, name)
        answer = client.call_async(kind.Request(**request))
        self.wait(answer.done, name)
        return answer.result()

    def wait_ticks(self, count: int) -> list[Tick]:
        """So many more ticks."""
        begun = len(self.ticks)
        self.wait(lambda: len(self.ticks) >= begun + count, f"{count} ticks")
        return self.ticks[begun:]

    def wait_report(self, name: str, wanted: Callable[[Health], bool]) -> Health:
        """The next report of a node that is as wanted."""
        self.health.pop(name, None)
        self.wait(lambda: name in self.health and wanted(self.health[name]), f"a report of {name}")
        return self.health[name]

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module")
def observer(ros_domain: int) -> Iterator[Observer]:
    observer = Observer()
    yield observer
    observer.close()


@pytest.fixture(scope="module")
def children(observer: Observer, planar_bag: Path) -> Iterator[Children]:
    """The simulated planar robot, waiting in lockstep at its first tick; more may be started beside it."""
    with Children() as children:
        command = [*program("rled_sim", "sim_node"), "--robot", "planar", "--start-points", str(planar_bag)]
        children.start([*command, "--discovery-wait", "0.2"])
        observer.wait(lambda: bool(observer.ticks), "the first tick")
        yield children
        children.check()
