"""The page: viser's server behind the gate, the scene, the visitors, and the loop that keeps them up to date."""

import contextlib
import io
import os
import time
import traceback
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event, Thread, get_native_id

import viser

from rled_teleop.web.access import Access
from rled_teleop.web.control import Control
from rled_teleop.web.graph_state import GraphState
from rled_teleop.web.inbound import check_values
from rled_teleop.web.protection import protected, require_free
from rled_teleop.web.recording_manager import RecordingManager
from rled_teleop.web.robot import load_robot
from rled_teleop.web.scene import Scene
from rled_teleop.web.view_panel import AT_FIRST
from rled_teleop.web.visitor import Visitor

FRAME, TEXT, PLOT = 1 / 30, 1 / 5, 1.0
"""Seconds between two drawings of the scene, of texts, of plots."""
HEARTBEAT_PERIOD, HEARTBEAT_PERIOD_HELD = 0.5, 0.1
"""Seconds between two questions to the driver's page whether it is alive, at rest and while it holds something."""
HEARTBEAT_TIMEOUT = 1.0
NICENESS, LOWEST = 10, 19
"""By how much the page gives way to other work of this machine (steps of nice), and how far that goes."""


class Page:
    """Serves until it is closed.

    Args:
        host: address to serve at.
        port: port, which must be free.
        access: who is let in.
        graph: what the graph says.
        control: what visitors want.
        folder: for bags.

    Raises:
        RledError: the port is taken.
    """

    def __init__(self, host: str, port: int, access: Access, graph: GraphState, control: Control, folder: Path) -> None:
        require_free(host, port)
        self._manager = RecordingManager(folder, graph, control.requests)
        _yield_to_control()
        with protected(access):
            self._server = viser.ViserServer(host=host, port=port, label="RLED", verbose=False)
        self._graph, self._control = graph, control
        self._scene, self._shown = Scene(self._server), set(AT_FIRST)
        self._visitors: dict[int, Visitor] = {}
        self._drawn: tuple[object, ...] = ()
        self._set_look()
        self._server.on_client_connect(self._on_arrival)
        self._server.on_client_disconnect(self._on_leave)

    def run(self, stop: Event) -> None:
        """Keep the page up to date until the event is set."""
        Thread(target=self._listen_for_life, args=(stop,), daemon=True).start()
        due = {self._renew_scene: 0.0, self._renew_texts: 0.0, self._renew_plots: 0.0}
        periods = dict(zip(due, (FRAME, TEXT, PLOT), strict=True))
        while not stop.is_set():
            now = time.monotonic()
            for work in due:
                if now >= due[work]:
                    due[work] = max(due[work] + periods[work], now)
                    _try(work)
            stop.wait(max(0.0, min(due.values()) - time.monotonic()))

    def close(self) -> None:
        """Complete the recording and end."""
        with contextlib.redirect_stdout(io.StringIO()):  # viser says that it has stopped
            self._server.stop()
        self._manager.close()

    def _set_look(self) -> None:
        warnings.filterwarnings("ignore", "Queued a .* on a closed connection")  # who leaves while a page is drawn
        self._server.gui.configure_theme(
            control_layout="fixed", control_width="large", show_logo=False, show_share_button=False
        )

    async def _on_arrival(self, client: viser.ClientHandle) -> None:
        check_values(client)
        self._control.arrive(client.client_id)
        self._visitors[client.client_id] = Visitor(client, self._control, self._graph, self._manager, self._shown)

    async def _on_leave(self, client: viser.ClientHandle) -> None:
        self._control.leave(client.client_id)
        self._visitors.pop(client.client_id, None)

    def _renew_scene(self) -> None:
        graph = self._graph
        task, tick = graph.task, graph.tick
        if task is None or tick is None or not graph.description:
            return
        if self._drawn != (graph.description, task):
            self._drawn = (graph.description, task)
            self._scene.draw(load_robot(graph.description), task, tick)
        if not self._visitors:
            return
        self._scene.move(tick)
        angles = self._manager.frame(time.monotonic())
        if angles is None:
            self._scene.hide_ghost()
        else:
            self._scene.move_ghost(angles)
        self._each(Visitor.follow)

    def _renew_texts(self) -> None:
        if self._visitors:
            self._scene.draw_curve(self._graph.curve)
            self._scene.draw_trail(self._graph.pieces() if "trail" in self._shown else None)
            self._scene.show_limits(self._shown)
        self._manager.measure()
        self._each(Visitor.renew)

    def _renew_plots(self) -> None:
        self._each(Visitor.draw_curves)

    def _each(self, work: Callable[[Visitor], None]) -> None:
        """Do something for each visitor, whatever goes wrong for another."""
        for visitor in list(self._visitors.values()):
            _try(partial(work, visitor))

    def _listen_for_life(self, stop: Event) -> None:
        """Ask the driver's page for a sign of life; one that is hidden, frozen or cut off gives none."""
        while not stop.is_set():
            visitor = self._visitors.get(-1 if (driver := self._control.visitors.driver) is None else driver)
            if visitor is None:
                stop.wait(HEARTBEAT_PERIOD_HELD)
                continue
            if _is_alive(visitor.client):
                self._control.hear(visitor.client.client_id, visitor.holds)
            stop.wait(HEARTBEAT_PERIOD_HELD if visitor.holds else HEARTBEAT_PERIOD)


def _yield_to_control() -> None:
    """Let whoever makes and answers ticks go first on a busy machine: this thread yields, and those that it starts."""
    thread = get_native_id()
    os.setpriority(os.PRIO_PROCESS, thread, min(os.getpriority(os.PRIO_PROCESS, thread) + NICENESS, LOWEST))


def _try(work: Callable[[], None]) -> None:
    """Do something; what goes wrong is shown, and ends neither the page nor the robot's control."""
    try:
        work()
    except Exception:
        traceback.print_exc()


def _is_alive(client: viser.ClientHandle) -> bool:
    try:
        client.local_storage.get_item("alive", timeout=HEARTBEAT_TIMEOUT)
    except TimeoutError:
        return False
    except RuntimeError as error:
        return "disconnected" not in str(error)  # a browser that blocks its storage answers too
    return True
