"""The handle at the tool that the driver drags."""

from typing import Any

import numpy as np
import viser
from rled_msgs_py.task import TaskDescription

from rled_teleop.web.control import Control
from rled_teleop.web.watched import Watched
from rled_teleop.web.wish import Follow

SIZE = 0.22
NEAR = 1e-4
"""Motion of the tool that the handle does not follow (m)."""


class ToolHandle:
    """Arrows and planes at the tool; where they are dragged the tool goes, until the pointer is released.

    Args:
        client: whose page it is on.
        control: takes the wishes.

    Attributes:
        held: the pointer holds it.
    """

    def __init__(self, client: viser.ClientHandle, control: Control) -> None:
        self._client, self._control = client, control
        self._gizmo: Any = None
        self._task: TaskDescription | None = None
        self.held = False

    def follow(self, watched: Watched, drives: bool) -> None:
        """Bring it to the tool, unless it is held; show it to the driver alone."""
        tick, task = watched.tick, watched.task
        if tick is None or task is None:
            return
        if task is not self._task:
            self._make(task)
        if self._gizmo.visible != drives:
            self._gizmo.visible = drives
            self.held = False
        if not self.held and float(np.abs(self._gizmo.position - tick.ee.position).max()) > NEAR:
            self._gizmo.position = tick.ee.position

    def _make(self, task: TaskDescription) -> None:
        if self._gizmo is not None:
            self._gizmo.remove()
        self._task = task
        self._gizmo = self._client.scene.add_transform_controls(
            "/handle",
            scale=SIZE,
            line_width=4.0,
            active_axes=(0 in task.axes, 1 in task.axes, 2 in task.axes),
            disable_rotations=True,
            depth_test=False,
            visible=False,
        )
        self._gizmo.on_update(self._on_drag)

    async def _on_drag(self, event: viser.TransformControlsEvent) -> None:
        self.held = event.phase != "end" and self._control.drives(event.client_id)
        if self.held:
            x, y, z = (float(each) for each in event.target.position)
            self._control.wish(event.client_id, Follow((x, y, z)))
        else:
            self._control.release(event.client_id)
