"""Node: answers each tick with the page's set point. ``teleop_web`` starts it, in a process of its own.

Nothing that a visitor does can delay it: it shares no interpreter with the page, and reads the newest set point instead
of being told.
"""

import os
import time
from dataclasses import dataclass
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rled_msgs_py.params import param
from rled_msgs_py.ros.node import declare, run_node, spin

from rled_teleop.nodes.operator_base import OperatorBase
from rled_teleop.operators.jog import Jog
from rled_teleop.web.set_point import OPERATOR, SetPointSlot
from rled_teleop.web.steering import steer


@dataclass(frozen=True)
class OperatorParams:
    """Parameters of the page's operator."""

    set_points: int = param(-1, "open file with the page's set points, from teleop_web", read_only=True)


class WebOperator(Node):
    """Moves the robot while the page wants it and lives; a command that it does not renew ends by itself."""

    def __init__(self, **options: Any) -> None:
        super().__init__(OPERATOR, **options)
        self._slot = SetPointSlot(declare(self, OperatorParams).set_points)
        self._page = os.getppid()
        self._base = OperatorBase(self, True, self._steer)
        self._base.start_timer(self._poll)

    def _poll(self) -> None:
        self._base.stand(self._slot.newest().beside)
        self._base.poll()

    def _steer(self, jog: Jog, q: NDArray[np.float64]) -> NDArray[np.float64] | None:
        if os.getppid() != self._page:  # the page was killed
            return None
        return steer(self._slot.newest(), jog, q, time.monotonic())


def _spin(node: WebOperator, stop: Event) -> None:
    spin(node, stop, EventsExecutor(context=node.context))


def main() -> None:
    """Run the node."""
    run_node(WebOperator, OperatorParams, OPERATOR, "Answer each tick as the page of teleop_web wants it.", _spin)


if __name__ == "__main__":
    main()
