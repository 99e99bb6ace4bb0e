"""A robot in real time, an agent that learns while it drives, and a recorder; for measurements that kill or last."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_agent.data.opening import open_demonstrations
from rled_agent.learners.cloning import CloningConfig, clone_expert
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.nn.policy import Policy, load_policy
from rled_msgs_py.processes import program
from rled_msgs_py.records import Health, JointSample
from rled_msgs_py.ros.node import fresh_context, spin_until, subscribe
from rled_msgs_py.topics import DIAGNOSTICS, JOINT_STATES, Qos

from ..conftest import free_domain

DEMONSTRATION = Path(__file__).parents[2] / "bags" / "planar_lemniscate"
WAIT_TIMEOUT = 120.0
AGENT = "agent_node: policy"


def expert_of(bag: Path, folder: Path) -> Path:
    """Weights of a small expert cloned from a bag."""
    torch.set_num_threads(1)
    config = CloningConfig(Architecture(hidden=(48, 48)), steps=1500)
    policy, _ = clone_expert(open_demonstrations(bag, "points"), config, np.random.default_rng(0), lambda point: None)
    policy.save(folder / "expert.safetensors")
    return folder / "expert.safetensors"


def actor_like(expert: Path, path: Path) -> Path:
    """The expert's weights in an actor with dropout, ready to learn."""
    policy = load_policy(expert)
    settings = replace(policy.network.architecture, dropout=0.1)
    sizes = policy.network.sizes[0], policy.network.sizes[-1]
    network = Perceptron(*sizes, settings, Draws([0]), squash=True)
    network.load_state_dict(policy.network.state_dict())
    Policy(network, policy.scaling, policy.task).save(path)
    return path


@dataclass
class Team:
    """The three nodes as processes, each to be started, killed and started again.

    Attributes:
        folder: where the learning state and the bags lie.
        expert: weights of the expert.
        sim_options: more options of the simulation, as typed.
        processes: the newest process of each node.
        bags: all that were recorded.
    """

    folder: Path
    expert: Path
    sim_options: tuple[str, ...] = ()
    processes: "dict[str, subprocess.Popen[bytes]]" = field(default_factory=dict)
    bags: list[Path] = field(default_factory=list)

    @property
    def learning_state(self) -> Path:
        """Where learning keeps its state."""
        return self.folder / "learning.safetensors"

    def command(self, name: str) -> list[str]:
        """How to start a node; a recorder gets a bag of its own each time."""
        if name == "sim":
            options = ["--robot", "planar", "--mode", "real_time", "--discovery-wait", "0.2", *self.sim_options]
            return [*program("rled_sim", "sim_node"), *options]
        if name == "recorder":
            self.bags.append(self.folder / f"bag{len(self.bags)}")
            return [*program("rled_teleop", "record_demos"), "--output", str(self.bags[-1])]
        actor = self.expert.with_name("actor.safetensors")
        if not actor.exists():
            actor_like(self.expert, actor)
        options = ["--expert", self.expert, "--agent", actor, "--learning-state", self.learning_state, "--learn"]
        options += ["--learning-priority", "low"]  # on a busy machine too
        return [*program("rled_agent", "agent_node"), *map(str, options)]

    def start(self, name: str) -> None:
        """Start a node."""
        with (self.folder / f"{name}.log").open("ab") as log:
            self.processes[name] = subprocess.Popen(self.command(name), stdout=log, stderr=log)

    def kill(self, name: str) -> None:
        """SIGKILL a node."""
        self.processes[name].kill()
        self.processes[name].wait()

    def stop(self) -> dict[str, float]:
        """End all by SIGINT; returns how long each took (s)."""
        took = {}
        for name in ("recorder", "agent", "sim"):
            began, process = time.monotonic(), self.processes[name]
            process.send_signal(signal.SIGINT)
            process.wait(WAIT_TIMEOUT)
            took[name] = time.monotonic() - began
        return took


@contextmanager
def private_graph() -> Iterator[None]:
    """A domain of this program's own, on this machine."""
    with free_domain() as domain:
        os.environ |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        yield


@contextmanager
def running(team: Team) -> Iterator[Team]:
    """The team at work; whoever still lives at the end is killed."""
    try:
        for name in ("sim", "agent", "recorder"):
            team.start(name)
        yield team
    finally:
        for process in team.processes.values():
            process.kill()
            process.wait()


class Watch:
    """Hears the robot's joints and the nodes' reports; it keeps nothing but the newest."""

    def __init__(self, on_joints: Callable[[JointSample], None] = lambda joints: None) -> None:
        self._context = fresh_context()
        self.node = Node("watch", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.health: dict[str, tuple[float, Health]] = {}
        subscribe(self.node, replace(JOINT_STATES, qos=Qos(depth=10_000)), on_joints)
        subscribe(self.node, DIAGNOSTICS, self._on_health)

    def _on_health(self, health: Health) -> None:
        self.health[health.name] = time.monotonic(), health

    def spin(self, seconds: float) -> None:
        """Watch for a while."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._executor.spin_once(timeout_sec=0.1)

    def wait(self, done: Callable[[], bool], what: str) -> None:
        """Watch until a predicate holds."""
        spin_until(self._executor, done, WAIT_TIMEOUT, what)

    def report(self, name: str, since: float) -> Health | None:
        """A node's newest report that came after a moment of the steady clock."""
        came, health = self.health.get(name, (0.0, None))
        return health if came > since else None

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()
