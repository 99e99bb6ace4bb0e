"""Moving the robot by buttons that are held and by the sliders of its joints, and the simulation's own switches."""

import time
from collections.abc import Callable
from typing import Any

import viser
from rled_msgs_py.task import TaskDescription

from rled_teleop.web.control import Control
from rled_teleop.web.graph_state import GraphState
from rled_teleop.web.jog_command import Follow, Move, Turn

HOLD_RATE = 20.0
"""Signs of life a second of a button that is held."""
COMMAND_DURATION = 0.15
"""So long a motion lasts after the last of them, or after a slider was last moved (s)."""
SETTLING_TIME = 0.6
"""A slider is brought to its joint when it has not been moved for so long (s)."""
AXES = ("x", "y", "z")
SWITCHES = {"Run": "run", "Pause": "pause", "New episode": "reset", "Release stop": "release"}


class DrivingPanel:
    """One visitor's controls.

    Args:
        client: whose page it is on.
        control: takes the commands.
        graph: what the graph says.
    """

    def __init__(self, client: viser.ClientHandle, control: Control, graph: GraphState) -> None:
        self._client, self._control, self._graph = client, control, graph
        self._task: TaskDescription | None = None
        self._moved = -SETTLING_TIME
        self._enabled = False
        gui = client.gui
        gui.add_markdown("Drag the arrows at the tool, or hold a button. Letting go stops.")
        self._speed = gui.add_slider("Speed %", 1, 100, 1, round(100 * control.share))
        self._speed.on_update(self._on_speed)
        self._go = gui.add_button("To the target", color="green", icon=viser.Icon.TARGET_ARROW)
        self._go.on_hold(self._on_go, HOLD_RATE)
        self._time = gui.add_button_group("Simulation", tuple(SWITCHES))
        self._time.on_click(self._on_time)
        self._retarget = gui.add_checkbox("Arrows at the target too", False)
        self._tool = gui.add_folder("Move the tool")
        self._joints = gui.add_folder("Turn the joints")
        self._arrows: list[Any] = []
        self._sliders: list[Any] = []

    @property
    def moves_target(self) -> bool:
        """The visitor wants to drag the target."""
        return bool(self._retarget.value)

    def enable(self, enabled: bool) -> None:
        """Let the visitor use it, or not."""
        self._enabled = enabled
        for each in (self._speed, self._go, self._retarget, *self._arrows, *self._sliders):
            each.disabled = not enabled
        self._time.visible = enabled  # viser cannot disable a group of buttons

    def renew(self) -> None:
        """Bring it up to date."""
        task, tick = self._graph.task, self._graph.tick
        if task is None or tick is None:
            return
        if task is not self._task:
            self._make(task)
        if time.monotonic() - self._moved > SETTLING_TIME:
            q = tick.joints.ordered(task.joint_names).position
            for slider, angle in zip(self._sliders, q.tolist(), strict=True):
                slider.value = round(min(max(angle, slider.min), slider.max), 3)
            self._speed.value = round(100 * self._control.share)

    def _make(self, task: TaskDescription) -> None:
        self._task = task
        for each in (*self._arrows, *self._sliders):
            each.remove()
        gui = self._client.gui
        with self._tool:
            self._arrows = [self._arrow(axis, sign) for axis in task.axes for sign in (1.0, -1.0)]
        with self._joints:
            limits = zip(task.joint_names, task.joint_lower, task.joint_upper, strict=True)
            self._sliders = [
                gui.add_slider(name.rpartition("_")[2], round(low, 3), round(high, 3), 0.001, min(max(0.0, low), high))
                for name, low, high in limits
            ]
        for joint, slider in enumerate(self._sliders):
            slider.on_update(self._turn(joint))
        self.enable(self._enabled)

    def _arrow(self, axis: int, sign: float) -> Any:
        button = self._client.gui.add_button(f"{AXES[axis]} {'+' if sign > 0 else '−'}", color="blue")
        direction = [0.0, 0.0, 0.0]
        direction[axis] = sign
        x, y, z = direction

        async def hold(event: viser.GuiEvent[Any]) -> None:
            self._control.command(event.client_id, Move((x, y, z)), COMMAND_DURATION)

        button.on_hold(hold, HOLD_RATE)
        return button

    def _turn(self, joint: int) -> Callable[[viser.GuiEvent[Any]], Any]:
        async def turn(event: viser.GuiEvent[Any]) -> None:
            if event.client_id is not None and self._control.drives(event.client_id):
                self._moved = time.monotonic()
                self._control.command(event.client_id, Turn(joint, float(event.target.value)), COMMAND_DURATION)

        return turn

    async def _on_speed(self, event: viser.GuiEvent[Any]) -> None:
        self._control.set_share(event.client_id, float(event.target.value) / 100.0)

    async def _on_go(self, event: viser.GuiEvent[Any]) -> None:
        if self._graph.tick is not None:
            x, y, z = self._graph.tick.target.position.tolist()
            self._control.command(event.client_id, Follow((x, y, z)), COMMAND_DURATION)

    async def _on_time(self, event: viser.GuiEvent[Any]) -> None:
        self._control.ask(event.client_id, SWITCHES[event.target.value])
