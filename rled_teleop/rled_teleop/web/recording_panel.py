"""Recording: episodes begun, ended and judged; their list; recorded ones played back in the view."""

from typing import Any

import viser

from rled_teleop.web.control import Control
from rled_teleop.web.episode_log import EpisodeEntry
from rled_teleop.web.graph_state import GraphState
from rled_teleop.web.recording_manager import RecordingManager

NONE = "(none)"
NEWEST = 12
"""Episodes that are listed."""
SIGNS = {"recording": "🔴", "ended": "•", "keep": "✔ kept", "discard": "✘ discarded"}


class RecordingPanel:
    """One visitor's recorder.

    Args:
        client: whose page it is on.
        control: takes the requests.
        graph: what the graph says.
        manager: recorder, bags and replays.
    """

    def __init__(
        self, client: viser.ClientHandle, control: Control, graph: GraphState, manager: RecordingManager
    ) -> None:
        self._client, self._control, self._graph, self._manager = client, control, graph, manager
        gui = client.gui
        self._start = self._button("Begin episode", viser.Icon.PLAYER_RECORD, "start")
        self._stop = self._button("End episode", viser.Icon.PLAYER_STOP, "stop")
        self._rest = [
            self._button("Keep", viser.Icon.CHECK, "keep", "green"),
            self._button("Discard", viser.Icon.TRASH, "discard", "orange"),
            self._button("Mark pose", viser.Icon.MAP_PIN, "mark pose"),
        ]
        self._finish = gui.add_button("Finish the bag", icon=viser.Icon.PACKAGE, color="indigo")
        self._finish.on_click(self._on_finish)
        self._list = gui.add_markdown("")
        with gui.add_folder("Recorded bags"):
            self._bags = gui.add_dropdown("Bag", (NONE,))
            self._bags.on_update(self._on_bag)
            self._table = gui.add_markdown("")
            self._episode = gui.add_dropdown("Episode", (NONE,))
            self._play = gui.add_button("Replay", icon=viser.Icon.PLAYER_PLAY, color="indigo")
            self._play.on_click(self._on_play)
        self._opened, self._enabled = "", False

    def enable(self, enabled: bool) -> None:
        """Let the visitor use it, or not."""
        self._enabled = enabled
        for each in (self._start, self._stop, *self._rest, self._finish, self._bags, self._episode):
            each.disabled = not enabled

    def renew(self) -> None:
        """Bring it up to date."""
        running, entries = self._graph.log.running, self._graph.log.entries()
        self._start.visible, self._stop.visible = not running, running
        self._finish.visible = self._manager.records
        said = self._manager.said
        self._list.content = "  \n".join([*([f"*{said}*"] if said else []), entries_table(entries)])
        self._choose(self._bags, (NONE, *self._manager.bags))
        if self._manager.opened != self._opened and (self._manager.opened or NONE) in self._bags.options:
            self._opened = self._manager.opened
            self._bags.value = self._opened or NONE
        self._choose(self._episode, tuple(map(str, self._manager.replayable)) or (NONE,))
        self._table.content = self._manager.table
        self._play.disabled = not (self._enabled and self._manager.replayable)
        self._play.label = "Stop the replay" if self._manager.plays else "Replay"

    @staticmethod
    def _choose(dropdown: Any, options: tuple[str, ...]) -> None:
        if tuple(dropdown.options) != options:
            dropdown.options = options

    def _button(self, label: str, icon: viser.Icon, what: str, colour: Any = "blue") -> Any:
        button = self._client.gui.add_button(label, icon=icon, color=colour)

        async def click(event: viser.GuiEvent[Any]) -> None:
            if not self._control.drives(event.client_id):
                return
            if what == "start":
                self._manager.begin_episode()
            else:
                self._control.ask(event.client_id, what)

        button.on_click(click)
        return button

    async def _on_finish(self, event: viser.GuiEvent[Any]) -> None:
        if self._control.drives(event.client_id):
            self._manager.finish()

    async def _on_bag(self, event: viser.GuiEvent[Any]) -> None:
        if event.client_id is not None and self._control.drives(event.client_id):
            self._manager.open(None if event.target.value == NONE else event.target.value)

    async def _on_play(self, event: viser.GuiEvent[Any]) -> None:
        if self._control.drives(event.client_id) and self._episode.value != NONE:
            self._manager.play(int(self._episode.value))


def entries_table(entries: list[EpisodeEntry]) -> str:
    """The newest episodes as Markdown."""
    if not entries:
        return "No episode yet."
    rows = [f"| {each.number} | {SIGNS[each.state]} | {each.seconds:.1f} | {_mark(each)} |" for each in entries]
    return "\n".join(["| # | | s | quality |", "|---|---|---|---|", *rows[-NEWEST:]])


def _mark(entry: EpisodeEntry) -> str:
    if entry.quality is None:
        return entry.outcome
    return f"{entry.quality.score:.2f} ({entry.quality.reached:.0%} reached, detour {entry.quality.detour:.2f})"
