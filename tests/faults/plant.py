"""A simulated robot in a process of its own, and somebody who sends it anything and watches what it does."""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import decode
from rled_msgs_py.processes import Child, Children, program
from rled_msgs_py.records import DeltaCommand, Health, Text
from rled_msgs_py.reset_answer import ResetAnswer
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile, to_msg
from rled_msgs_py.ros.node import advertise, fresh_context, spin_until, subscribe
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import STATE_TOPICS, Tick, TickAssembler
from rled_msgs_py.topics import DIAGNOSTICS, JOINT_DELTA, TASK_DESCRIPTION, Qos, Topic
from rled_sim.commands import Code
from rled_sim.robots import ROBOTS
from std_srvs.srv import Trigger

WAIT_TIMEOUT = 60.0
DEEP = 100_000
"""Samples that the watcher's readers keep: it may be slower than the graph."""


class Peer:
    """A node in a process of its own, by its services.

    Args:
        plant: that it lives beside.
        name: of the node.
        child: its process.

    Attributes:
        plant: as given.
        name: as given.
        child: the newest process, if it was started again.
    """

    def __init__(self, plant: "Plant", name: str, child: Child) -> None:
        self.plant, self.name, self.child = plant, name, child
        self._clients: dict[str, Any] = {}

    def call(self, kind: type, name: str, request: Any = None, **fields: Any) -> Any:
        """The answer of a service."""
        if name not in self._clients:
            self._clients[name] = self.plant.node.create_client(kind, f"{self.name}/{name}")
        client = self._clients[name]
        self.plant.wait(lambda: client.service_is_ready() or self._is_gone(), name)
        answer = client.call_async(request or kind.Request(**fields))  # type: ignore[attr-defined]
        self.plant.wait(lambda: answer.done() or self._is_gone(), f"an answer of {name}")
        assert not self._is_gone(), list(self.child.last_lines)
        return answer.result()

    def set(self, **values: Any) -> str:
        """Set parameters; why it was refused, if it was."""
        wanted = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        results = self.call(SetParameters, "set_parameters", parameters=wanted).results
        return " ".join(each.reason for each in results if not each.successful)

    def ping(self) -> None:
        """Wait for any answer."""
        self.call(GetParameters, "get_parameters", names=[])

    def resident(self) -> float:
        """Memory of its process (MB)."""
        status = Path(f"/proc/{self.child.process.pid}/status").read_text()
        return int(status.partition("VmRSS:")[2].split()[0]) / 1024.0

    def settle(self) -> None:
        """Wait until its memory has been the same for two seconds: all is loaded."""
        seen = [(0.0, 0.0)]  # memory, and since when

        def settled() -> bool:
            now, memory = time.monotonic(), self.resident()
            if memory > seen[0][0] + 0.1:
                seen[0] = memory, now
            return now > seen[0][1] + 2.0

        self.plant.wait(settled, f"{self.name} to settle")

    def _is_gone(self) -> bool:
        return self.child.exit_code is not None


class Plant:
    """A context manager: ``sim_node`` with arguments, watched.

    Attributes:
        children: the simulation, and what else is started.
        sim: its node.
        ticks: all ticks so far.
        health: reports of all nodes, newest last.
        forged: messages that are not the simulation's, whatever they say.
    """

    def __init__(self, *arguments: str) -> None:
        self.children = Children()
        self._motors = "motors" in arguments
        self.sim = Peer(self, "sim", self._started(*arguments))
        self.context = fresh_context()
        self.node = Node("watcher", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.ticks: list[Tick] = []
        self.health: list[Health] = []
        self._tasks: list[TaskDescription] = []
        self.forged: set[bytes] = set()
        self._listen()
        self._reported = 0.0
        subscribe(self.node, replace(DIAGNOSTICS, qos=Qos(depth=DEEP)), self._on_health)
        subscribe(self.node, TASK_DESCRIPTION, self._on_task)
        self.output = advertise(self.node, JOINT_DELTA)

    @property
    def simulation(self) -> Child:
        return self.sim.child

    def start(self, *arguments: str) -> None:
        """Start a simulation; it is the one that is watched from now on."""
        self.sim.child = self._started(*arguments)

    def _started(self, *arguments: str) -> Child:
        command = [*program("rled_sim", "sim_node"), "--discovery-wait", "0.2", *arguments]
        return self.children.start(command, echo=False)

    def __enter__(self) -> "Plant":
        met = lambda: self.ticks and self._tasks and self.output.get_subscription_count()  # noqa: E731
        self.wait(lambda: bool(met()), "the simulation")
        return self

    def __exit__(self, *_: object) -> None:
        self.children.end()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    @property
    def task(self) -> TaskDescription:
        return self._tasks[-1]

    @property
    def tick(self) -> Tick:
        return self.ticks[-1]

    def _listen(self) -> None:
        assembler = TickAssembler()

        def received(topic: Topic, data: bytes) -> None:
            if data not in self.forged:
                with suppress(ContractError):  # forged too, and padded on its way
                    record: Any = decode(topic, data)
                    if (tick := assembler.add(topic.name, record)) is not None:
                        self.ticks.append(tick)

        for topic in STATE_TOPICS:
            qos = qos_profile(replace(topic.qos, depth=DEEP))
            kind, hear = MESSAGE_CLASSES[topic.type], partial(received, topic)
            self.node.create_subscription(kind, topic.name, hear, qos, raw=True)

    def _on_task(self, text: Text) -> None:
        if not self._tasks:  # what comes later may be a rogue's
            self._tasks.append(TaskDescription.from_json(text.data))

    def _on_health(self, health: Health) -> None:
        self.health.append(health)
        self._reported = time.monotonic()

    def wait(self, done: Callable[[], bool], what: str, seconds: float = WAIT_TIMEOUT) -> None:
        spin_until(self.executor, done, seconds, what)

    def command(self, delta: Sequence[float], stamp: int | None = None) -> Any:
        """A valid message that answers the newest tick."""
        stamp = self.tick.stamp if stamp is None else stamp
        return to_msg(DeltaCommand(stamp, self.task.joint_names, np.array(delta, dtype=np.float64)))

    def step(self, delta: Sequence[float]) -> Tick:
        """Answer the newest tick and wait for the next."""
        before = self.tick.stamp
        self.output.publish(self.command(delta))
        self.wait(lambda: self.tick.stamp > before, "a tick")
        return self.tick

    def go(self, *q: float, largest: float = 0.04) -> Tick:
        """Step towards joint angles (rad) until they are met, lockstep."""
        while (farthest := np.abs(way := np.array(q) - self.tick.joints.position).max()) > 1e-9:
            before = self.tick
            tick = self.step(way * min(1.0, largest / farthest))
            assert not np.array_equal(tick.joints.position, before.joints.position), tick.status.refused
        return self.tick

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        """The answer of a service of the simulation."""
        return self.sim.call(kind, name, **fields)

    def reset(self) -> None:
        """Begin an episode and wait for its first tick."""
        begins = ResetAnswer.from_json(self.call(Trigger, "reset").message).stamp
        self.wait(lambda: self.tick.stamp >= begins, "the new episode")

    def set(self, **values: Any) -> str:
        """Set parameters of the simulation; why it was refused, if it was."""
        return self.sim.set(**values)

    def measure(self, act: Callable[[], Any], decided: Callable[[], Any], what: str) -> float:
        """Milliseconds from an act to what shows that it was decided on."""
        began = time.monotonic()
        act()
        while not decided():
            assert time.monotonic() < began + WAIT_TIMEOUT, f"waited {WAIT_TIMEOUT} s for {what}"
            self.executor.spin_once(timeout_sec=0.05)
        return 1e3 * (time.monotonic() - began)

    def send(self, message: Any) -> Callable[[], None]:
        """To publish a message, for ``measure``."""
        return lambda: self.output.publish(message)

    def moved_on(self) -> Callable[[], bool]:
        """Whether there is a newer tick than now."""
        before = self.tick.stamp
        return lambda: self.tick.stamp > before

    def reported(self, code: Code) -> Callable[[], bool]:
        """Whether a report tells of one more such refusal than now.

        A refusal is reported at once unless a report went out just before, so this waits until that is a while ago.
        """
        self.wait(lambda: bool(self.health) and time.monotonic() > self._reported + 0.15, "a report")
        counter, begun = f"commands_{code.name.lower()}", len(self.health)
        before = int(self.health[-1].values[counter])
        return lambda: any(int(each.values.get(counter, 0)) > before for each in self.health[begun:])

    def outside_limits(self, since: int = 0) -> list[str]:
        """Motions beyond Δq_max and joints beyond their limits, from a tick on; a new episode may begin elsewhere.

        Motors follow their set point as fast as the URDF lets them, so they may make up for a lag.
        """
        task, found = self.task, []
        slack = 1e-6 * task.max_delta
        rates = np.array([joint.velocity for joint in ROBOTS[task.robot].joints])
        most = np.maximum(task.max_delta, rates * task.period * 1e-9) if self._motors else task.max_delta
        for before, after in zip(self.ticks[since:], self.ticks[since + 1 :], strict=False):
            q, moved = after.joints.position, after.joints.position - before.joints.position
            if after.status.episode == before.status.episode and (np.abs(moved) > most + slack).any():
                found.append(f"moved by {moved} at {after.stamp} ns")
            if (q < np.array(task.joint_lower) - slack).any() or (q > np.array(task.joint_upper) + slack).any():
                found.append(f"joints at {q} at {after.stamp} ns")
        return found


def learning_process(node: Child) -> list[int]:
    """The processes in which an agent node learns; one that has ended is not among them."""
    parent = node.process.pid
    children = map(int, Path(f"/proc/{parent}/task/{parent}/children").read_text().split())
    return [each for each in children if b"learner_process" in Path(f"/proc/{each}/cmdline").read_bytes()]
