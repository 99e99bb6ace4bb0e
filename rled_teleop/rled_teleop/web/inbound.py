"""What a visitor may send: the kinds of message that the page uses, each of a bounded size, with checked values.

Viser reads whatever its protocol has: files, forms, pictures of the scene, properties of controls, commands. Nothing
but what is described here reaches it, written anew from what was understood.
"""

import math
from typing import Annotated, Any

import msgspec
import viser
from msgspec import Meta, Struct
from viser import _messages as messages
from viser.infra import ClientId

MAX_MESSAGE_SIZE = 4096
"""Longest message (bytes); the page sends some hundred."""

Name = Annotated[str, Meta(max_length=200)]
Text = Annotated[str, Meta(max_length=1000)]
Number = Annotated[float, Meta(ge=-1e9, le=1e9)]  # no NaN and no infinity either
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]


class _Message(Struct, tag_field="type", tag=lambda name: f"{name}Message", forbid_unknown_fields=True):
    """A message, named as viser names it."""


class ViewerCamera(_Message):
    """Where a visitor looks from."""

    wxyz: Quaternion
    position: Vector
    fov: Number
    near: Number
    far: Number
    image_height: Number
    image_width: Number
    look_at: Vector
    up_direction: Vector


class TransformControlsUpdate(_Message):
    """A handle was dragged."""

    name: Name
    wxyz: Quaternion
    position: Vector
    owner: Name = ""


class TransformControlsDragStart(_Message):
    """A handle was taken."""

    name: Name
    owner: Name = ""


class TransformControlsDragEnd(_Message):
    """A handle was released."""

    name: Name
    owner: Name = ""


class Update(Struct, forbid_unknown_fields=True):
    """The value of a control, and none of its other properties."""

    value: bool | Number | Text


class GuiUpdate(_Message):
    """A control was used."""

    uuid: Name
    updates: Update


class GuiButtonHold(_Message):
    """A button is held."""

    uuid: Name
    frequency: Number


class LocalStorageGetItemResponse(_Message):
    """A sign of life."""

    value: Text | None
    error: Text | None
    request_uuid: Name


_Accepted = (
    ViewerCamera
    | TransformControlsUpdate
    | TransformControlsDragStart
    | TransformControlsDragEnd
    | GuiUpdate
    | GuiButtonHold
    | LocalStorageGetItemResponse
)
_decoder = msgspec.msgpack.Decoder(_Accepted)
_encoder = msgspec.msgpack.Encoder()


def understood(data: bytes | str) -> bytes | None:
    """A visitor's message as it is handed on; None for one that the page has no use for."""
    if not isinstance(data, bytes) or len(data) > MAX_MESSAGE_SIZE:
        return None
    try:
        return _encoder.encode(_decoder.decode(data))
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


def accepts(control: Any, value: Any) -> bool:
    """Whether a control of the page can be given a value: one of its choices, or a number within its range."""
    if isinstance(control, viser.GuiButtonHandle | viser.GuiCheckboxHandle):
        return isinstance(value, bool)
    if isinstance(control, viser.GuiDropdownHandle | viser.GuiButtonGroupHandle):
        return isinstance(value, str) and value in control.options
    if isinstance(control, viser.GuiSliderHandle | viser.GuiNumberHandle):
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        low, high = control.min, control.max
        return is_number and (low is None or low <= value) and (high is None or value <= high)
    return False


def check_values(client: viser.ClientHandle) -> None:
    """Have each value that a visitor gives a control checked by ``accepts``; another one springs back."""
    gui, wire = client.gui, client.gui._websock_interface

    async def take(visitor: ClientId, message: messages.GuiUpdateMessage) -> None:
        control = gui._gui_input_handle_from_uuid.get(message.uuid)
        if control is None:
            return
        if accepts(control, message.updates["value"]):
            await gui._handle_gui_updates(visitor, message)
        else:
            wire.queue_message(messages.GuiUpdateMessage(message.uuid, {"value": control.value}))

    wire.unregister_handler(messages.GuiUpdateMessage)
    wire.register_handler(messages.GuiUpdateMessage, take)
