"""The simulation on one host and the agent on another: two network namespaces, joined by a cable that can be cut."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Thread

import pytest
from rled_msgs_py.processes import program

ADDRESS = "10.77.{}.{}"
WAIT_TIMEOUT = 60.0
STILL = 0.2
"""Seconds without motion that count as holding still; a tick is 20 ms."""


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


class Hosts:
    """Two hosts named after this process, and the cable between them."""

    def __init__(self, number: int) -> None:
        self.names = [f"rled{os.getpid()}{side}" for side in "ab"]
        self.addresses = [ADDRESS.format(number, end) for end in (1, 2)]

    def connect(self) -> None:
        for name in self.names:
            ip("netns", "add", name)
        one, other = self.names
        ip("link", "add", "cable", "netns", one, "type", "veth", "peer", "name", "cable", "netns", other)
        for name, address in zip(self.names, self.addresses, strict=True):
            ip("-n", name, "addr", "add", f"{address}/24", "dev", "cable")
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "link", "set", "cable", "up")

    def cut(self, off: bool) -> None:
        ip("-n", self.names[1], "link", "set", "cable", "down" if off else "up")

    def remove(self) -> None:
        for name in self.names:
            subprocess.run(["ip", "netns", "delete", name], capture_output=True)

    @contextmanager
    def running(self, side: int, *command: str) -> Iterator[subprocess.Popen[str]]:
        """A process on a host, which knows the other by its address only."""
        environment = os.environ | {
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_STATIC_PEERS": self.addresses[1 - side],
        }
        process = subprocess.Popen(
            ["ip", "netns", "exec", self.names[side], *command], env=environment, text=True, stdout=subprocess.PIPE
        )
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    hosts = Hosts(os.getpid() % 250)
    try:
        hosts.connect()
    except (subprocess.CalledProcessError, FileNotFoundError):
        hosts.remove()
        pytest.skip("network namespaces need root and iproute2 (apt-get install iproute2)")
    yield hosts
    hosts.remove()


class Motion:
    """What the watcher on the robot's host sees."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.states: list[tuple[float, list[float]]] = []
        self._process = process
        Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            when, _, position = json.loads(line)
            self.states.append((when, position))

    def last_move(self) -> float:
        """When the joints last were elsewhere than before."""
        moves = [now for (_, a), (now, b) in zip(self.states, self.states[1:], strict=False) if a != b]
        return max(moves, default=0.0)

    def holds(self) -> bool:
        """The robot stands still, which is seen."""
        moved, seen = self.last_move(), self.states[-1][0]
        return seen - moved > STILL > time.monotonic() - seen

    def wait(self, done: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + WAIT_TIMEOUT
        while not done():
            assert time.monotonic() < deadline, f"waited in vain for {what}"
            time.sleep(0.01)


@pytest.mark.skipif(shutil.which("ip") is None, reason="network namespaces need iproute2")
def test_a_cut_network_holds_the_robot_and_it_goes_on_when_joined(hosts, planar_expert: Path) -> None:
    sim = [*program("rled_sim", "sim_node"), "--robot", "planar", "--mode", "real_time", "--discovery-wait", "0.2"]
    agent = [*program("rled_agent", "agent_node"), "--expert", str(planar_expert)]
    watch = [sys.executable, str(Path(__file__).with_name("watch.py"))]
    with ExitStack() as stack:
        stack.enter_context(hosts.running(0, *sim))
        motion = Motion(stack.enter_context(hosts.running(0, *watch)))
        stack.enter_context(hosts.running(1, *agent))
        motion.wait(lambda: time.monotonic() - motion.last_move() < STILL, "motion")
        for _ in range(2):
            hosts.cut(True)
            cut = time.monotonic()
            motion.wait(motion.holds, "a hold while its ticks go on")
            assert motion.last_move() - cut < 2.0  # two periods of 20 ms, and what a busy machine adds
            hosts.cut(False)
            motion.wait(lambda: time.monotonic() - motion.last_move() < STILL, "motion again")
