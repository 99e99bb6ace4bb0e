"""What the page says at the top."""

from html import escape

import numpy as np
from rled_msgs_py.records import GateCode, Level

from rled_teleop.web.control import Control
from rled_teleop.web.graph_state import GraphState

SIM_REPORT = "sim: driver"
LINES, LINE = 5, 1.45
"""Lines that are seen without scrolling, and the height of one (em)."""
STYLE = f"padding:0 1em;margin-bottom:0.4em;font-size:0.9em;line-height:{LINE};height:{LINES * LINE}em;overflow-y:auto"

GREEN, GREY, BLUE, ORANGE, RED = "#16a34a", "#9499a3", "#2563eb", "#ea880c", "#dc2626"


def status_text(graph: GraphState, control: Control, visitor: int) -> str:
    """Some lines of HTML for one visitor, always of one height: a warning must not move the buttons below."""
    lines = [_who(control, visitor), *_robot(graph), *_warnings(graph)]
    return f'<div style="{STYLE}">{"<br>".join(lines)}</div>'


def _spot(colour: str, text: str) -> str:
    return f'<span style="color:{colour}">&#9679;</span> {text}'


def _who(control: Control, visitor: int) -> str:
    if control.drives(visitor):
        return _spot(GREEN, "<b>You drive.</b>")
    if control.visitors.driver is None:
        return _spot(GREY, "<b>Nobody drives.</b> Press Drive to begin.")
    return _spot(BLUE, "<b>You watch;</b> another visitor drives.")


def _robot(graph: GraphState) -> list[str]:
    task, tick = graph.task, graph.tick
    if task is None or tick is None:
        return ["Waiting for a simulation: start <code>sim_node</code>, or this page with <code>--robot panda</code>."]
    axes = list(task.axes)
    away = float(np.linalg.norm((tick.target.position - tick.ee.position)[axes]))
    status = tick.status
    of = f" of {task.targets_per_episode}" if task.targets_per_episode else ""
    violations = f", violations {status.violations}" if status.violations else ""
    return [
        f"{escape(task.robot)}, episode {status.episode}, step {status.step}, {tick.stamp * 1e-9:.1f} s",
        f"targets reached {status.targets_reached}{of}, distance {away * 100:.1f} cm{violations}",
    ]


def _warnings(graph: GraphState) -> list[str]:
    said = []
    health = graph.health(SIM_REPORT)
    if health is not None and health.level is not Level.OK:
        summary = health.message.partition(", the last")[0]
        said.append(_spot(RED if health.level is Level.ERROR else ORANGE, escape(summary)))
    elif health is not None and health.message == "paused":
        said.append(_spot(ORANGE, "paused"))
    tick, decision, nodes = graph.tick, graph.decision, graph.nodes
    if tick is not None and tick.status.refused:
        said.append(_spot(ORANGE, f"refused: {escape(tick.status.refused)}"))
    if nodes.agent and decision is not None and decision.code is GateCode.ASKING:
        said.append(_spot(ORANGE, "<b>the agent is unsure and asks for you</b>"))
    if nodes.beside and nodes.others:
        said.append(f"driven by {escape(', '.join(nodes.others))}")
    if graph.log.running:
        said.append(_spot(RED, "<b>recording</b>"))
    if nodes.answer:
        said.append(f"<i>{escape(nodes.answer)}</i>")
    return said
