"""What the page of a visitor who drives may send: nothing of it raises, and no command is beyond numbers."""

from pathlib import Path

import msgspec
import numpy as np
from viser import _messages as messages

from ..mutators.values import mutate_messagepack as mutate
from ..page import MARK, open_page

__all__ = ["REFUSALS", "mutate", "read", "seeds"]

REFUSALS = ()


def seeds() -> list[bytes]:
    """One message of each kind that the page sends."""
    page = open_page()
    sent = [
        messages.GuiUpdateMessage(f"{MARK}{label}", {"value": value or True}) for label, value in page.values.items()
    ]
    sent += [
        messages.GuiButtonHoldMessage(f"{MARK}x +", 20.0),
        messages.TransformControlsDragStartMessage("/handle", page.owner),
        messages.TransformControlsUpdateMessage("/handle", (1.0, 0.0, 0.0, 0.0), (0.3, 0.2, 0.1), page.owner),
        messages.TransformControlsDragEndMessage("/handle", page.owner),
        messages.LocalStorageGetItemResponseMessage(None, None, "0"),
        messages.ViewerCameraMessage((1, 0, 0, 0), (1, 1, 1), 0.8, 0.01, 100.0, 600, 800, (0, 0, 0), (0, 0, 1)),
    ]
    return [msgspec.msgpack.encode(each.as_serializable_dict([])) for each in sent]


def read(data: bytes, _: Path) -> None:
    page = open_page()
    page.tell(data)
    set_point = page.set_points[-1]
    assert set_point.command is None or np.isfinite(np.hstack(list(set_point.command))).all(), (
        f"the command {set_point.command}"
    )
    assert 0.0 <= set_point.share <= 1.0, f"a share of full speed of {set_point.share}"
    target = page.control.requests.take().get("target", (0.0,))
    assert np.isfinite(target).all(), f"a target at {target}"
