"""The learner and its gate: who acts, curves, settings, taking over and handing back."""

import math
import time
from functools import partial
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from rled_teleop.web.control import Control
from rled_teleop.web.graph_state import GraphState

AGENT_REPORT = "agent_node: policy"
BLUE, ORANGE, GREEN, RED = "#2563eb", "#ea880c", "#16a34a", "#dc2626"
MEASURES = ("qcd", "iqr")
HEIGHT = 150
SETTLING_TIME = 2.0
"""A setting shows what the agent has when nobody has set it for so long (s)."""
METRICS = {
    "slowest_answer_ms": "slowest answer (ms)",
    "deadlines_missed": "deadlines missed",
    "offered": "transitions learned from",
    "handovers": "new weights",
}
"""What is told of the agent's report."""
BUTTONS = {
    "Learn": ("learn", viser.Icon.SCHOOL),
    "Stop learning": ("rest", viser.Icon.PLAYER_PAUSE),
    "Save checkpoint": ("save", viser.Icon.DEVICE_FLOPPY),
}


class LearningPanel:
    """One visitor's view of the learner.

    Args:
        client: whose page it is on.
        control: takes the requests.
        graph: what the graph says.
    """

    def __init__(self, client: viser.ClientHandle, control: Control, graph: GraphState) -> None:
        self._control, self._graph = control, graph
        gui = client.gui
        self._text = gui.add_markdown("")
        self._take = gui.add_button("Take over", color="orange", icon=viser.Icon.HAND_GRAB)
        self._take.on_click(self._on_take)
        self._xi = gui.add_number("ξ threshold", 1e-3, min=0.0, max=1e9, step=1e-6)
        self._phi = gui.add_number("Φ", 0.0, min=0.0, max=1.0, step=0.01, visible=False)
        self._query = gui.add_number("Ask a person (s)", 0.0, min=0.0, max=3600.0, step=0.1, visible=False)
        self._measure = gui.add_dropdown("Measure", MEASURES, visible=False)
        self._set: dict[str, float] = {}
        for name, each in self._inputs.items():
            each.on_update(partial(self._on_setting, name))
        self._buttons = [self._button(gui, label, *rest) for label, rest in BUTTONS.items()]
        self._uncertainty = _plot(gui, "uncertainty u (blue) and ξ (red), seconds", (BLUE, RED))
        self._returns = _plot(gui, "return, by episode", (BLUE,))
        self._targets = _plot(gui, "targets reached, by episode", (GREEN,))
        self._share = _plot(gui, "share of demonstrated actions, by episode", (ORANGE,))

    @property
    def _inputs(self) -> dict[str, Any]:
        return {
            "threshold": self._xi,
            "phi": self._phi,
            "query_timeout": self._query,
            "measure": self._measure,
        }

    def enable(self, enabled: bool) -> None:
        """Let the visitor use it, or not."""
        for each in (self._take, *self._inputs.values(), *self._buttons):
            each.disabled = not enabled

    def renew(self) -> None:
        """Bring texts and settings up to date."""
        nodes = self._graph.nodes
        self._text.content = self._said()
        self._take.visible = nodes.beside
        self._take.label = "Hand back" if self._control.taken else "Take over"
        for each in self._buttons:
            each.visible = nodes.agent
        for name, each in self._inputs.items():
            each.visible = name in nodes.parameters
            settled = time.monotonic() - self._set.get(name, -math.inf) > SETTLING_TIME
            if settled and name in nodes.parameters and nodes.parameters[name] != each.value:
                each.value = nodes.parameters[name]

    def draw_curves(self) -> None:
        """Bring the plots up to date."""
        time, uncertainty, threshold = self._graph.decisions()
        number, total, targets, share = self._graph.episodes()
        for plot, curves in (
            (self._uncertainty, (time, uncertainty, threshold)),
            (self._returns, (number, total)),
            (self._targets, (number, targets)),
            (self._share, (number, share)),
        ):
            plot.visible = len(curves[0]) > 1
            if plot.visible:
                plot.data = tuple(np.ascontiguousarray(each) for each in curves)

    def _said(self) -> str:
        decision, health = self._graph.decision, self._graph.health(AGENT_REPORT)
        if not self._graph.nodes.agent and decision is None:
            return "No agent in this graph: start `agent_node`, or this page with `--with-agent agent_node`."
        lines = []
        if decision is not None:
            lines.append(f"**{decision.actor.value}** acts: {decision.reason}")
            if not math.isnan(decision.uncertainty):
                lines.append(f"u = {decision.uncertainty:.3g}, ξ = {decision.threshold:.3g} ({decision.measure})")
        if health is not None:
            values = ", ".join(
                f"{text} {health.values[name]}" for name, text in METRICS.items() if name in health.values
            )
            lines.append(f"agent: {health.message}; {values}")
        return "  \n".join(lines)

    def _button(self, gui: viser.GuiApi, label: str, what: str, icon: viser.Icon) -> Any:
        button = gui.add_button(label, icon=icon, color="blue", visible=False)

        async def click(event: viser.GuiEvent[Any]) -> None:
            self._control.ask(event.client_id, what)

        button.on_click(click)
        return button

    async def _on_take(self, event: viser.GuiEvent[Any]) -> None:
        self._control.switch_taken(event.client_id)

    async def _on_setting(self, name: str, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is not None:
            self._set[name] = time.monotonic()
            self._control.ask(event.client_id, name, event.target.value)


def _plot(gui: viser.GuiApi, title: str, colours: tuple[str, ...]) -> Any:
    nothing: NDArray[np.float64] = np.zeros(2)
    lines = [uplot.Series(label=title.partition(",")[0], stroke=each, width=1.5) for each in colours]
    return gui.add_uplot(
        (nothing,) * (1 + len(colours)),
        (uplot.Series(label=""), *lines),
        title=title,
        scales={"x": uplot.Scale(time=False)},
        legend=uplot.Legend(show=False),
        height=HEIGHT,
        visible=False,
    )
