"""Node: serves a page to drive, watch and record on, with its operator and what a user wants started beside it.

Importing what the page needs takes a second. The other processes are started before that.
"""

import re
import shlex
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING

from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rled_msgs_py.errors import RledError
from rled_msgs_py.processes import Child, Children, program
from rled_msgs_py.ros.callbacks import raise_ending
from rled_msgs_py.ros.node import declare, run_node

from rled_teleop.web.access import access_for
from rled_teleop.web.params import WebParams
from rled_teleop.web.set_point import OPERATOR, SetPointSlot
from rled_teleop.web.token import Token, given_token

if TYPE_CHECKING:
    from rled_teleop.web.control import Control
    from rled_teleop.web.graph_state import GraphState

IS_TOKEN = re.compile(r"(.*:)?token:=")
SPIN_TIMEOUT = 0.05
"""Longest wait for a message before signals, children and page are looked at again (s)."""


class PageThread:
    """The page beside the node.

    Args:
        params: of the page.
        token: that opens it.
        graph: what the graph says.
        control: what visitors want.
    """

    def __init__(self, params: WebParams, token: Token, graph: "GraphState", control: "Control") -> None:
        self._params, self._token, self._graph, self._control = params, token, graph, control
        self._stop = Event()
        self._error: BaseException | None = None
        self._thread = Thread(target=self._run, name="page")
        self._thread.start()

    def check(self) -> None:
        """Hand on what ended the page.

        Raises:
            BaseException: whatever it was.
        """
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """End the page."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            self._serve()
        except BaseException as error:  # raised again by check, in the thread that can end the program
            self._error = error

    def _serve(self) -> None:
        from rled_teleop.web.page import Page

        params = self._params
        access = access_for(params.host, self._token.word)
        page = Page(params.host, params.port, access, self._graph, self._control, Path(params.output))
        print(f"page: {address(params, self._token)}", flush=True)
        try:
            page.run(self._stop)
        finally:
            page.close()


def _prepare(robot: str) -> None:
    """Read the robot that is about to be shown while everything else starts; another one is read when it is there."""
    from rled_sim.robots import ROBOTS

    from rled_teleop.web.robot import load_robot

    if robot in ROBOTS:
        load_robot(ROBOTS[robot].description)


def address(params: WebParams, token: Token) -> str:
    """Where a browser finds the page."""
    host = f"[{params.host}]" if ":" in params.host else params.host
    return f"http://{host}:{params.port}/{token.query}"


def serve(node: Node, stop: Event) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        RledError: a mistake in the parameters, or a child process failed.
    """
    params = declare(node, WebParams)
    token = given_token(params)
    access_for(params.host, token.word)
    if token.warning:
        node.get_logger().warning(token.warning)
    set_points = SetPointSlot()
    with Children() as children:
        _start(children, params)
        operator = _start_operator(children, set_points.file)
        Thread(target=_prepare, args=(params.robot,), daemon=True).start()
        page = _open(node, params, token, set_points)

        def check() -> None:
            children.check()
            page.check()
            if operator.exit_code is not None:
                raise RledError(f"{OPERATOR} has ended", "", "start teleop_web again")

        try:
            _spin(node, stop, check)
        finally:
            page.close()


def _open(node: Node, params: WebParams, token: Token, set_points: SetPointSlot) -> PageThread:
    from rled_teleop.nodes.graph_link import GraphLink
    from rled_teleop.web.control import Control
    from rled_teleop.web.graph_state import GraphState

    graph, control = GraphState(), Control(params.timeout, set_points.put)
    GraphLink(node, params, graph, control)
    return PageThread(params, token, graph, control)


def _start(children: Children, params: WebParams) -> None:
    if params.robot:
        command = [*program("rled_sim", "sim_node"), "--robot", params.robot, "--mode", "real_time"]
        endless = [] if params.with_agent else ["--targets-per-episode", "0", "--max-steps", "0"]
        command += ["--discovery-wait", "1", *endless, *shlex.split(params.sim_options)]
        children.start([*command, *_named(params.sim)])
    if params.with_agent:
        name, *options = shlex.split(params.with_agent)
        beside = Path(sys.executable).parent / name
        children.start([str(beside) if beside.is_file() else name, *options, *_named(params.agent)])


def _start_operator(children: Children, set_points: int) -> Child:
    """Start what answers ticks."""
    command = [*program("rled_teleop", OPERATOR), "--set-points", str(set_points), *_named(OPERATOR)]
    return children.start(command, files=(set_points,))


def _named(name: str) -> list[str]:
    """Options that put another node into this one's namespace, with its topics but under a name of its own."""
    given = sys.argv[sys.argv.index("--ros-args") + 1 :] if "--ros-args" in sys.argv else []
    return ["--ros-args", "-r", f"__node:={name}", *without_token(given)] if given else []


def without_token(given: list[str]) -> list[str]:
    """ROS arguments without the parameter that opens the page: it is for this process."""
    found = [k for k, each in enumerate(given) if IS_TOKEN.match(each) and k > 0 and given[k - 1] in ("-p", "--param")]
    return [each for k, each in enumerate(given) if k not in found and k + 1 not in found]


def _spin(node: Node, stop: Event, check: Callable[[], None]) -> None:
    executor = EventsExecutor(context=node.context)
    executor.add_node(node)
    due = 0.0
    try:
        while not stop.is_set() and node.context.ok():
            executor.spin_once(timeout_sec=SPIN_TIMEOUT)
            raise_ending(node)
            if (now := time.monotonic()) >= due:
                due = now + SPIN_TIMEOUT
                check()
    finally:
        executor.remove_node(node)


def main() -> None:
    """Run the node."""
    summary = "Serve a page to drive, watch and record on; --robot NAME starts all that it needs."
    run_node(partial(Node, "teleop_web"), WebParams, "teleop_web", summary, serve)


if __name__ == "__main__":
    main()
