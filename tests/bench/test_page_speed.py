"""The page: control at 100 Hz with three pages open and one flooding, and the time from the command to a robot."""

import time
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest
from rled_msgs_py.processes import Children, program
from viser import _messages as messages

from ..web.conftest import await_that, free_port, is_open
from ..web.socket_visitor import SocketVisitor
from .test_deadlines import PERIOD, Watch

SECONDS = 10.0


@pytest.fixture
def address() -> Iterator[str]:
    port = free_port()
    with Children() as children:
        options = ["--robot", "panda", "--sim-options", f"--period {PERIOD}", "--port", str(port)]
        children.start([*program("rled_teleop", "teleop_web"), *options])
        await_that(lambda: children.check() or is_open(port), "the page")
        yield f"http://127.0.0.1:{port}"


def driven(watch: Watch, me: SocketVisitor) -> np.ndarray:
    """From a state to its answer (s) while a button is held that goes back and forth between two ends."""
    with me.holding("To the target"):
        return watch.loops(SECONDS)


def test_pages_cost_control_no_deadlines(figure, address):
    with closing(Watch()) as watch:
        watch.wait(lambda: len(watch.answers) > 100, "answers")
        me = SocketVisitor(address)
        me.find("y +")
        one = driven(watch, me)
        others = [SocketVisitor(address) for _ in range(2)]
        three = driven(watch, me)
        flooding = others[0]
        flooding.begin_flood(messages.LocalStorageGetItemResponseMessage("x" * 1000, None, "none"))
        flooded = driven(watch, me)
        for each in (me, *others):
            each.close()
    figure("page_one_p99_ms", float(np.quantile(one, 0.99) * 1e3))
    figure("page_three_p99_ms", float(np.quantile(three, 0.99) * 1e3))
    figure("page_flooded_p99_ms", float(np.quantile(flooded, 0.99) * 1e3))
    figure("page_three_miss_share", float(np.mean(three > PERIOD)))
    figure("page_flooded_miss_share", float(np.mean(flooded > PERIOD)))
    assert np.mean(three > PERIOD) <= 1e-2


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
    assert moved < 5.0
