"""Between graph and page: what is heard goes into ``GraphState``, what visitors ask for comes from ``Control``."""

import time
from dataclasses import replace
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rled_msgs_py.messages import encode
from rled_msgs_py.records import PoseSample, Text
from rled_msgs_py.ros.callbacks import every, listen
from rled_msgs_py.ros.convert import qos_profile
from rled_msgs_py.ros.node import advertise, subscribe, subscribe_ticks
from rled_msgs_py.ros.waiting import report_waiting, waiting_for
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import (
    DIAGNOSTICS,
    EPISODE_EVENTS,
    JOINT_DELTA,
    JOINT_STATES,
    MARKERS,
    ROBOT_DESCRIPTION,
    SAFETY_GATE,
    TARGET_REQUEST,
    TASK_DESCRIPTION,
    Qos,
)
from visualization_msgs.msg import MarkerArray

from rled_teleop.nodes.graph_services import SERVICES, GraphServices
from rled_teleop.nodes.recorder_client import RecorderClient
from rled_teleop.operators.keys import Request
from rled_teleop.web.control import Control
from rled_teleop.web.graph_state import GraphState
from rled_teleop.web.params import WebParams
from rled_teleop.web.set_point import OPERATOR

MAX_POINTS = 2000
"""Points of a curve that is shown."""
POLL_PERIOD = 0.01
"""Seconds between two polls of what visitors ask for."""
DISCOVERY_PERIOD = 0.5
"""Seconds between two polls of who else is in the graph."""
DISCOVERY_TIME = 1.5
"""So long the page only listens before it lets states be answered: somebody else may (s)."""
RECORDER = {request.value: request for request in (Request.START, Request.STOP, Request.KEEP, Request.DISCARD,
                                                   Request.MARK)}  # fmt: skip


class GraphLink:
    """Listens to the graph and asks it for things, in the callbacks of a node.

    Args:
        node: the page's.
        params: its parameters.
        graph: takes what is heard.
        control: has what visitors want.
    """

    def __init__(self, node: Node, params: WebParams, graph: GraphState, control: Control) -> None:
        self._node, self._params, self._graph, self._control = node, params, graph, control
        self._recorder = RecorderClient(node, params.recorder)
        self._neighbours = GraphServices(node, {"sim": params.sim, "agent": params.agent})
        self._target = advertise(node, TARGET_REQUEST)
        self._said = (self._recorder.answer, self._neighbours.answer)
        self._markers: Subscription | None = None
        self._begun = time.monotonic()
        control.stand(params.role != "alone")
        subscribe_ticks(node, self._on_tick)
        subscribe(node, ROBOT_DESCRIPTION, self._on_robot)
        subscribe(node, TASK_DESCRIPTION, self._on_task)
        subscribe(node, JOINT_DELTA, graph.on_delta)
        subscribe(node, SAFETY_GATE, graph.on_decision)
        subscribe(node, DIAGNOSTICS, graph.on_health)
        subscribe(node, EPISODE_EVENTS, lambda text: graph.on_event(text.data))
        every(node, POLL_PERIOD, self._poll)
        every(node, DISCOVERY_PERIOD, self._discover)
        report_waiting(node, self._awaited)

    def _awaited(self) -> str:
        missing = [
            *([TASK_DESCRIPTION.name] if self._graph.task is None else []),
            *([JOINT_STATES.name] if self._graph.tick is None else []),
        ]
        return waiting_for(self._node, "sim_node", " and ".join(missing)) if missing else ""

    def _on_tick(self, tick: Tick) -> None:
        self._graph.on_tick(tick, self._control.is_commanded())

    def _on_robot(self, text: Text) -> None:
        self._graph.description = text.data

    def _on_task(self, text: Text) -> None:
        self._graph.task = TaskDescription.from_json(text.data)
        if self._markers is None:
            qos, limit = qos_profile(Qos(depth=1)), MARKERS.max_bytes
            self._markers = listen(self._node, MarkerArray, MARKERS.name, qos, self._on_markers, limit)

    def _on_markers(self, data: bytes) -> None:
        """Take the curve; it does not change, and nobody has to draw it for this node again."""
        for marker in deserialize_message(data, MarkerArray).markers:
            if marker.ns == "curve" and 0 < len(marker.points) <= MAX_POINTS:
                points = np.array([(point.x, point.y, point.z) for point in marker.points])
                if not np.isfinite(points).all():
                    continue
                self._graph.curve = list(map(tuple, points.tolist()))
                if self._markers is not None:
                    self._node.destroy_subscription(self._markers)
                    self._markers = None

    def _poll(self) -> None:
        for what, value in self._control.requests.take().items():
            self._ask(what, value)
        self._tell()

    def _ask(self, what: str, value: Any) -> None:
        if what == "target":
            self._retarget(value)
        elif what in SERVICES:
            self._neighbours.ask(what)
        elif what in RECORDER:
            self._recorder.ask(RECORDER[what])
        else:
            self._neighbours.set(what, value)

    def _retarget(self, point: Any) -> None:
        task, tick = self._graph.task, self._graph.tick
        if task is not None and tick is not None:
            request = PoseSample(tick.stamp, task.frame, np.array(point))
            self._target.publish(encode(TARGET_REQUEST, request))

    def _tell(self) -> None:
        """Show the page the newest answer."""
        said = (self._recorder.answer, self._neighbours.answer)
        if said != self._said:
            newest = next(new for new, old in zip(said, self._said, strict=True) if new != old)
            self._said = said
            self._graph.nodes = replace(self._graph.nodes, answer=newest)

    def _discover(self) -> None:
        others = self._others()
        if self._params.role == "auto" and time.monotonic() - self._begun > DISCOVERY_TIME:
            self._control.stand(beside=bool(others))
        self._neighbours.poll()
        self._graph.nodes = replace(
            self._graph.nodes,
            recorder=self._recorder.is_ready,
            agent=self._neighbours.has_agent,
            beside=self._control.beside,
            others=others,
            parameters=self._neighbours.parameters,
        )

    def _others(self) -> tuple[str, ...]:
        found = self._node.get_publishers_info_by_topic(JOINT_DELTA.name)
        return tuple(sorted({each.node_name for each in found} - {OPERATOR}))
