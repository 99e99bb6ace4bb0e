"""Node: serves a page to drive, watch and record on."""

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription
from rled_msgs_py.node import declare, run_node, subscribe
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import (
    DIAGNOSTICS,
    EPISODE_EVENTS,
    JOINT_DELTA,
    MARKERS,
    SAFETY_GATE,
)
from visualization_msgs.msg import MarkerArray

from rled_teleop.driving import Driving
from rled_teleop.jog import Jog
from rled_teleop.keys import Request
from rled_teleop.recorder_client import RecorderClient
from rled_teleop.web.control import Control
from rled_teleop.web.services import SERVICES, GraphServices
from rled_teleop.web.serving import serve
from rled_teleop.web.watched import Watched
from rled_teleop.web_params import WebParams

ROUND = 0.5
"""Seconds between two looks at who else is in the graph."""
LISTENING = 1.5
"""So long the node only listens before it answers states: somebody else may (s)."""
RECORDER = {request.value: request for request in (Request.START, Request.STOP, Request.KEEP, Request.DISCARD,
                                                   Request.MARK)}  # fmt: skip


class TeleopWeb(Node):
    """Answers ticks with what the page's driver wishes, and shows the page what the graph says.

    The page runs in threads of its own. It reaches this node by slots only: it looks at ``watched``, and what its
    visitors want lies in ``control``.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("teleop_web", **options)
        self.params = declare(self, WebParams)
        self.watched, self.control = Watched(), Control(self.params.timeout)
        self._recorder = RecorderClient(self, self.params.recorder)
        self._neighbours = GraphServices(self, {"sim": self.params.sim, "agent": self.params.agent})
        self._said = (self._recorder.answer, self._neighbours.answer)
        self._begun = time.monotonic()
        beside = self.params.role != "alone"
        self._driving = Driving(self, beside, self._steer, self._on_tick, self._on_robot)
        self._markers: Subscription | None = None
        self._listen()
        self._driving.start_timer(self._look)
        self.create_timer(ROUND, self._look_around, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _listen(self) -> None:
        watched = self.watched
        subscribe(self, JOINT_DELTA, watched.on_delta)
        subscribe(self, SAFETY_GATE, watched.on_decision)
        subscribe(self, DIAGNOSTICS, watched.on_health)
        subscribe(self, EPISODE_EVENTS, lambda text: watched.on_event(text.data))

    def _steer(self, jog: Jog, q: NDArray[np.float64]) -> NDArray[np.float64] | None:
        return self.control.steer(jog, q)

    def _on_tick(self, tick: Tick) -> None:
        self.watched.on_tick(tick, self.control.is_wished())

    def _on_robot(self, task: TaskDescription, urdf: str) -> None:
        self.watched.task, self.watched.description = task, urdf
        if self._markers is None:
            self._markers = self.create_subscription(MarkerArray, MARKERS.name, self._on_markers, 1)

    def _on_markers(self, message: MarkerArray) -> None:
        """Take the curve; it does not change, and nobody has to draw it for this node again."""
        for marker in message.markers:
            if marker.ns == "curve":
                self.watched.curve = [(point.x, point.y, point.z) for point in marker.points]
                if self._markers is not None:
                    self.destroy_subscription(self._markers)
                    self._markers = None

    def _look(self) -> None:
        for what, value in self.control.asked.take().items():
            self._ask(what, value)
        self._driving.look()
        self._tell()

    def _ask(self, what: str, value: Any) -> None:
        if what in SERVICES:
            self._neighbours.ask(what)
        elif what in RECORDER:
            self._recorder.ask(RECORDER[what])
        else:
            self._neighbours.set(what, value)

    def _tell(self) -> None:
        """Show the page the newest answer."""
        said = (self._recorder.answer, self._neighbours.answer)
        if said != self._said:
            newest = next(new for new, old in zip(said, self._said, strict=True) if new != old)
            self._said = said
            self.watched.seen = replace(self.watched.seen, answer=newest)

    def _look_around(self) -> None:
        others = self._others()
        if self.params.role == "auto" and time.monotonic() - self._begun > LISTENING:
            self._driving.stand(beside_agent=bool(others))
        self._neighbours.look()
        self.watched.seen = replace(
            self.watched.seen,
            recorder=self._recorder.is_ready,
            agent=self._neighbours.has_agent,
            beside=self._driving.beside_agent,
            others=others,
            parameters=self._neighbours.parameters,
        )

    def _others(self) -> tuple[str, ...]:
        found = self.get_publishers_info_by_topic(JOINT_DELTA.name)
        return tuple(sorted({each.node_name for each in found} - {self.get_name()}))


def main() -> None:
    """Run the node."""
    sys.setswitchinterval(1e-3)  # the page's threads must not keep the node's waiting
    summary = "Serve a page to drive, watch and record on; --robot NAME starts all that it needs."
    run_node(TeleopWeb, WebParams, "teleop_web", summary, serve)


if __name__ == "__main__":
    main()
