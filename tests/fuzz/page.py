"""The page with one visitor who drives, without a graph: what the visitor sends is handed to it as from the network."""

import asyncio
import socket
import tempfile
from contextlib import closing
from functools import lru_cache
from pathlib import Path
from threading import Event, Thread
from typing import Any

import msgspec
import numpy as np
from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.tick import Tick
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task
from rled_teleop.web import page as page_module
from rled_teleop.web.access import Access
from rled_teleop.web.control import Control
from rled_teleop.web.graph_state import GraphState, OtherNodes
from rled_teleop.web.inbound import understood
from rled_teleop.web.page import Page
from rled_teleop.web.set_point import SetPoint
from viser import _messages as viser_messages

from ..rled_msgs_py.samples import write_bag
from ..web.socket_visitor import SocketVisitor, _awaited

MARK = "#"
"""Before the label of a control, in the place of its identifier, which is another one each time."""
TIMEOUT = 30.0


class OpenPage:
    """A page that runs, and what came of the messages to it.

    Attributes:
        set_points: the newest set point for the operator.
        control: what the visitor may do.
        number: of the visitor.
        owner: of the visitor's handles.
        values: what each control can be set to, by its label.
    """

    def __init__(self) -> None:
        self.set_points = [SetPoint()]
        self._errors: list[BaseException] = []
        page_module._try = self._try
        self.control = Control(0.5, self._give)
        self._page = Page("127.0.0.1", port := _free_port(), Access(), self._graph(), self.control, _bags())
        self._server = self._page._server._websock_server
        self._loop = self._server._background_event_loop
        self._loop.set_exception_handler(lambda _, context: self._errors.append(_error_of(context)))
        Thread(target=self._page.run, args=(Event(),), daemon=True).start()
        self.visitor = SocketVisitor(f"http://127.0.0.1:{port}/")
        self.visitor.find("EMERGENCY STOP")
        self.visitor.find("Workspace")  # of the panel that comes last
        self.owner = str(_awaited(lambda: self.visitor._owners.get("/handle"), "handle"))
        (self.number,) = self._page._server.get_clients()
        elements = {
            str(each["label"]): (uuid, each) for uuid, each in self.visitor._elements.items() if "label" in each
        }
        self._identifiers = {label: uuid for label, (uuid, _) in elements.items()}
        self.values = {
            label: (each.get("options") or [each.get("value", True)])[0] for label, (_, each) in elements.items()
        }

    def tell(self, data: bytes) -> None:
        """Hand a message over and wait until it is dealt with.

        Raises:
            Exception: whatever a handler raised.
        """
        self.control.take(self.number)
        passed = understood(self._named(data))
        if passed is not None:
            asyncio.run_coroutine_threadsafe(self._deliver(passed), self._loop).result(TIMEOUT)
        if self._errors:
            raise self._errors.pop()

    async def _deliver(self, data: bytes) -> None:
        message = viser_messages.Message.deserialize(data)
        client = self._page._server.get_clients()[self.number]
        await self._server._handle_incoming_message(self.number, message)
        await client._websock_connection._handle_incoming_message(self.number, message)
        await asyncio.sleep(0)

    def _named(self, data: bytes) -> bytes:
        """The same with the identifiers of controls in the places of their labels."""
        try:
            message = msgspec.msgpack.decode(data)
            if str(message["uuid"]).startswith(MARK):
                message["uuid"] = self._identifiers.get(message["uuid"].removeprefix(MARK), "")
                return msgspec.msgpack.encode(message)
        except Exception:  # no message, or one that has none
            return data
        return data

    def _give(self, set_point: SetPoint) -> None:
        self.set_points[:] = [set_point]

    def _try(self, work: Any) -> None:
        try:
            work()
        except Exception as error:
            self._errors.append(error)

    def _graph(self) -> GraphState:
        graph, robot = GraphState(), ROBOTS["planar"]
        graph.task, graph.description = reach_task(robot).description, robot.description
        graph.nodes = OtherNodes(recorder=True, agent=True)
        frame, q = graph.task.frame, np.array(robot.home)
        ee, target = PoseSample(0, frame, robot.chain.position(q)), PoseSample(0, frame, np.array([0.3, 0.2, 0.1]))
        joints = JointSample(0, graph.task.joint_names, q, np.zeros(len(q)))
        graph.on_tick(Tick(joints, ee, target, TaskStatus(0, 0, 0, 0.0, 0, False, 0, False, False)), False)
        return graph


@lru_cache
def open_page() -> OpenPage:
    return OpenPage()


def _bags() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="rled-fuzz-page-"))
    write_bag(folder / "bag", ticks=20)
    return folder


def _free_port() -> int:
    with closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _error_of(context: dict[str, Any]) -> BaseException:
    return context.get("exception") or RuntimeError(context["message"])
