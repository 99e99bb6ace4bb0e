"""What is shown of the scene; the same for all visitors, so the driver chooses."""

from functools import partial
from typing import Any

import viser
from rled_msgs_py.records import Actor

from rled_teleop.web.control import Control
from rled_teleop.web.trail import COLOURS

NAMES = {Actor.AGENT: "agent", Actor.EXPERT: "expert or script", Actor.HUMAN: "person", Actor.HOLD: "nobody"}


SWITCHES = {"trail": "Trail", "zones": "Keep-out zones", "workspace": "Workspace", "joints": "Joint limits"}
AT_FIRST = ("trail", "zones")


class ViewPanel:
    """One visitor's switches.

    Args:
        client: whose page it is on.
        control: tells who may use them.
        shown: names of what is shown.
    """

    def __init__(self, client: viser.ClientHandle, control: Control, shown: set[str]) -> None:
        self._control, self._shown = control, shown
        self._switches = {name: client.gui.add_checkbox(text, name in shown) for name, text in SWITCHES.items()}
        for name, each in self._switches.items():
            each.on_update(partial(self._on_switch, name))
        client.gui.add_html(legend())

    def enable(self, enabled: bool) -> None:
        """Let the visitor use it, or not."""
        for each in self._switches.values():
            each.disabled = not enabled

    def renew(self) -> None:
        """Bring it up to date."""
        for name, each in self._switches.items():
            each.value = name in self._shown

    async def _on_switch(self, name: str, event: viser.GuiEvent[Any]) -> None:
        if self._control.drives(event.client_id):
            (self._shown.add if event.target.value else self._shown.discard)(name)


def legend() -> str:
    """The colours of the trail."""
    spots = "".join(
        f'<div><span style="color:rgb{COLOURS[actor]}">&#9632;</span> {name}</div>' for actor, name in NAMES.items()
    )
    return f'<div style="padding:0 1em;font-size:0.85em"><b>Trail: who acted</b>{spots}</div>'
