"""The handles that the driver drags: one at the tool, one at the target."""

from collections.abc import Callable
from typing import Any

import numpy as np
import viser
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick

from rled_teleop.web.control import Control
from rled_teleop.web.graph_state import GraphState
from rled_teleop.web.jog_command import Follow

SIZE = 0.22
TARGET_SIZE = 0.13
NEAR = 1e-4
"""Motion of the tool or target that its handle does not follow (m)."""
Point = tuple[float, float, float]


class Handle:
    """Arrows and planes at a point of each tick; it is told where they are dragged, until the pointer is released.

    Args:
        client: whose page it is on.
        control: who drives.
        name: of the handle.
        size: length of the arrows (m).
        place: where the point is in a tick (m), shape (3,).
        dragged: called with the visitor and the place of the handle (m); with None at the end.

    Attributes:
        held: the pointer holds it.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        control: Control,
        name: str,
        size: float,
        place: Callable[[Tick], Any],
        dragged: Callable[[int | None, Point | None], None],
    ) -> None:
        self._client, self._control, self._name, self._size = client, control, name, size
        self._place, self._dragged = place, dragged
        self._gizmo: Any = None
        self._task: TaskDescription | None = None
        self.held = False

    def follow(self, graph: GraphState, shown: bool) -> None:
        """Bring it to its point, unless it is held; show it or not."""
        tick, task = graph.tick, graph.task
        if tick is None or task is None:
            return
        if task is not self._task:
            self._make(task)
        if self._gizmo.visible != shown:
            self._gizmo.visible = shown
            self.held = False
        place = self._place(tick)
        if not self.held and float(np.abs(self._gizmo.position - place).max()) > NEAR:
            self._gizmo.position = place

    def _make(self, task: TaskDescription) -> None:
        if self._gizmo is not None:
            self._gizmo.remove()
        self._task = task
        self._gizmo = self._client.scene.add_transform_controls(
            self._name,
            scale=self._size,
            line_width=4.0,
            active_axes=(0 in task.axes, 1 in task.axes, 2 in task.axes),
            disable_rotations=True,
            depth_test=False,
            visible=False,
        )
        self._gizmo.on_update(self._on_drag)

    async def _on_drag(self, event: viser.TransformControlsEvent) -> None:
        self.held = event.phase != "end" and self._control.drives(event.client_id)
        x, y, z = (float(each) for each in event.target.position)
        self._dragged(event.client_id, (x, y, z) if self.held else None)


def tool_handle(client: viser.ClientHandle, control: Control) -> Handle:
    """The tool goes where its handle is dragged, until the pointer is released."""

    def dragged(visitor: int | None, point: Point | None) -> None:
        if point is None:
            control.release(visitor)
        else:
            control.command(visitor, Follow(point))

    return Handle(client, control, "/handle", SIZE, lambda tick: tick.ee.position, dragged)


def target_handle(client: viser.ClientHandle, control: Control) -> Handle:
    """The target goes where its handle is dragged; the robot does not, unless somebody makes it."""

    def dragged(visitor: int | None, point: Point | None) -> None:
        if point is not None:
            control.ask(visitor, "target", point)

    return Handle(client, control, "/target_handle", TARGET_SIZE, lambda tick: tick.target.position, dragged)
