"""The page: control at 100 Hz with three pages open and one flooding, and the time from the command to a robot."""

import sys
import time
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest
from rled_msgs_py.processes import Children, program

from ..web.conftest import await_that, free_port, is_open
from ..web.socket_visitor import SocketVisitor
from .conftest import wanted
from .test_deadlines import PERIOD, Watch

SECONDS = 20.0


@pytest.fixture
def address() -> Iterator[str]:
    port = free_port()
    with Children() as children:
        options = ["--robot", "panda", "--sim-options", f"--period {PERIOD}", "--port", str(port)]
        children.start([*program("rled_teleop", "teleop_web"), *options])
        await_that(lambda: children.check() or is_open(port), "the page")
        yield f"http://127.0.0.1:{port}"


def driven(watch: Watch, address: str, *visitors: str) -> np.ndarray:
    """From a state to its answer (s) while a visitor drives."""
    with Children() as children:
        child = children.start([sys.executable, "-m", "tests.bench.page_visitors", address, *visitors])
        watch.wait(lambda: "there" in child.last_lines, "the visitors")
        return watch.loops(SECONDS)


def test_pages_cost_control_no_deadlines(figure, address):
    with closing(Watch()) as watch:
        watch.wait(lambda: len(watch.answers) > 100, "answers")
        loops = {
            "one": driven(watch, address, "1"),
            "three": driven(watch, address, "3"),
            "flooded": driven(watch, address, "3", "--flood"),
        }
    for name, seconds in loops.items():
        figure(f"page_{name}_p99_ms", float(np.quantile(seconds, 0.99) * 1e3))
        figure(f"page_{name}_miss_share", float(np.mean(seconds > PERIOD)))
    worst = max(float(np.mean(seconds > PERIOD)) for seconds in loops.values())
    wanted(worst <= 1e-3, "page_*_miss_share of 0.001 at most")


def test_from_the_command_to_a_robot_that_moves(figure):
    port, begun = free_port(), time.monotonic()
    with Children() as children:
        children.start([*program("rled_teleop", "teleop_web"), "--robot", "panda", "--port", str(port)])
        await_that(lambda: children.check() or is_open(port), "the page")
        opened = time.monotonic() - begun
        me = SocketVisitor(f"http://127.0.0.1:{port}")
        me.find("y +")
        with me.holding("y +"):
            await_that(lambda: me.received["MeshMessage"] > 10, "the robot")
            await_that(lambda: me.received["SetPositionMessage"] > 30, "motion")
        moved = time.monotonic() - begun
        me.close()
    figure("page_open_s", opened)
    figure("page_moving_robot_s", moved)
    wanted(moved < 5.0, "page_moving_robot_s below 5")
