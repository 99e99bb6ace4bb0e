"""The page as one visitor has it: what it says at the top, the emergency stop, who drives, and the tabs."""

from typing import Any

import viser

from rled_teleop.web.control import Control
from rled_teleop.web.driving_panel import DrivingPanel
from rled_teleop.web.graph_state import GraphState
from rled_teleop.web.handle import target_handle, tool_handle
from rled_teleop.web.learning_panel import LearningPanel
from rled_teleop.web.recording_manager import RecordingManager
from rled_teleop.web.recording_panel import RecordingPanel
from rled_teleop.web.status import status_text
from rled_teleop.web.view_panel import ViewPanel


class Visitor:
    """One open page.

    Args:
        client: viser's handle of it.
        control: what the visitor may do to the robot.
        graph: what the graph says.
        manager: the recorder, bags and replays.
        shown: names of what is shown of the scene.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        control: Control,
        graph: GraphState,
        manager: RecordingManager,
        shown: set[str],
    ) -> None:
        self.client, self._control, self._graph = client, control, graph
        gui = client.gui
        self._status = gui.add_html("")
        self._stop = gui.add_button("EMERGENCY STOP", color="red", icon=viser.Icon.HAND_STOP)
        self._stop.on_click(self._on_stop)
        self._wheel = gui.add_button("Drive", icon=viser.Icon.STEERING_WHEEL)
        self._wheel.on_click(self._on_wheel)
        tabs = gui.add_tab_group()
        self._handle, self._target = tool_handle(client, control), target_handle(client, control)
        with tabs.add_tab("Drive", viser.Icon.ARROWS_MOVE):
            self._driving = DrivingPanel(client, control, graph)
        with tabs.add_tab("Record", viser.Icon.VIDEO):
            self._recording = RecordingPanel(client, control, graph, manager)
        with tabs.add_tab("Learn", viser.Icon.CHART_LINE):
            self._learning = LearningPanel(client, control, graph)
        with tabs.add_tab("View", viser.Icon.EYE):
            self._view = ViewPanel(client, control, shown)
        self._drives: bool | None = None

    @property
    def holds(self) -> bool:
        """The pointer holds the handle of the tool."""
        return self._handle.held

    def follow(self) -> None:
        """Bring the handles to tool and target; many times a second."""
        drives = self._control.drives(self.client.client_id)
        self._handle.follow(self._graph, drives)
        self._target.follow(self._graph, drives and self._driving.moves_target)

    def renew(self) -> None:
        """Bring texts and controls up to date; some times a second."""
        me = self.client.client_id
        drives = self._control.drives(me)
        if drives != self._drives:
            self._drives = drives
            for panel in (self._driving, self._recording, self._learning, self._view):
                panel.enable(drives)
        with self.client.atomic():
            self._status.content = status_text(self._graph, self._control, me)
            self._wheel.label = "Let go" if drives else "Drive"
            self._wheel.disabled = not drives and not self._control.may_take(me)
            self._driving.renew()
            self._recording.renew()
            self._learning.renew()
            self._view.renew()

    def draw_curves(self) -> None:
        """Bring the plots up to date; once a second is enough."""
        self._learning.draw_curves()

    async def _on_stop(self, _: Any) -> None:
        self._control.stop()

    async def _on_wheel(self, _: Any) -> None:
        me = self.client.client_id
        if self._control.drives(me):
            self._control.let_go(me)
        else:
            self._control.take(me)
