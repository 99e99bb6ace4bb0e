"""What becomes of the robot when a process of the page dies or hangs; the simulation is not the page's child."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rled_msgs_py.processes import Child, Children, program

from .conftest import await_that, free_port, is_open
from .socket_visitor import SocketVisitor


@pytest.fixture(scope="module", autouse=True)
def simulation(ros_domain: int) -> Iterator[None]:
    options = ["--robot", "planar", "--mode", "real_time", "--targets-per-episode", "0", "--max-steps", "0"]
    with Children() as children:
        children.start([*program("rled_sim", "sim_node"), *options])
        yield


TIMEOUT = 1.5
FAR = (0.45, -0.35, 0.1)
"""A point that the tool does not reach within a test, at the speed chosen (m)."""


class Page:
    """A page that joins the simulation, with a visitor who drags the tool and does not let go."""

    def __init__(self, children: Children) -> None:
        port = free_port()
        options = ["--port", str(port), "--role", "alone", "--timeout", str(TIMEOUT)]
        self.process: Child = children.start([*program("rled_teleop", "teleop_web"), *options])
        await_that(lambda: children.check() or is_open(port), "the page")
        self.visitor = SocketVisitor(f"http://127.0.0.1:{port}")
        self.visitor.enter("Speed %", 5)
        self.visitor.drag(*FAR)

    def signal(self, number: int) -> float:
        """Send the page's process a signal; return when."""
        os.kill(self.process.process.pid, number)
        return time.monotonic()

    def kill_operator(self) -> float:
        """Kill the process that answers ticks; return when."""
        pid = self.process.process.pid
        (operator,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        os.kill(int(operator), signal.SIGKILL)
        return time.monotonic()


@pytest.fixture
def page(watcher: Any) -> Iterator[Page]:
    with Children() as children:
        page = Page(children)
        watcher.await_that(watcher.moves, "motion")
        yield page
        page.visitor.close()


def test_motion_stops_within_200_ms_when_the_page_is_killed(page: Page, watcher: Any) -> None:
    killed = page.signal(signal.SIGKILL)
    watcher.await_that(watcher.rests, "the robot to rest")
    assert watcher.last_motion(killed) - killed < 0.2
    ticks = len(watcher.ticks)
    watcher.await_that(lambda: len(watcher.ticks) > ticks + 10, "ticks: the simulation goes on")


def test_motion_ends_with_its_wish_when_the_page_hangs_and_the_page_goes_on(page: Page, watcher: Any) -> None:
    hung = page.signal(signal.SIGSTOP)
    watcher.await_that(watcher.rests, "the robot to rest")
    assert watcher.last_motion(hung) - hung < TIMEOUT + 0.2
    page.signal(signal.SIGCONT)
    page.visitor.drag(*FAR)
    watcher.await_that(watcher.moves, "motion again")


def test_the_page_ends_and_says_why_when_its_operator_is_killed(page: Page, watcher: Any) -> None:
    killed = page.kill_operator()
    watcher.await_that(watcher.rests, "the robot to rest")
    assert watcher.last_motion(killed) - killed < 0.2
    assert page.process.process.wait(20.0) == 2
    assert any("web_operator ended by signal SIGKILL" in line for line in page.process.last_lines)
