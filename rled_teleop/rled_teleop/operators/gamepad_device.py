"""A gamepad read directly from Linux's input devices by the library evdev, as joy_node would publish it."""

from collections.abc import Sequence
from typing import Any, Protocol

from rled_msgs_py.errors import RledError

from rled_teleop.operators.gamepad import PadState

EV_KEY, EV_ABS = 0x01, 0x03
FIRST_BUTTON, LAST_BUTTON = 0x130, 0x13F
"""BTN_GAMEPAD and the codes after it: linux/input-event-codes.h."""
BUTTONS = (0x130, 0x131, 0x133, 0x134, 0x136, 0x137, 0x13A, 0x13B, 0x13C, 0x13D, 0x13E)
"""A, B, X, Y, shoulders, back, start, guide, sticks: the order of joy_node."""
AXES = (0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x10, 0x11)
"""ABS_X, ABS_Y, ABS_Z, ABS_RX, ABS_RY, ABS_RZ and the hat: the order of joy_node."""
REMEDY = "plug one in, name its device, or read the topic joy"


class Device(Protocol):
    """What is used of evdev's InputDevice."""

    name: str

    def capabilities(self) -> dict[int, Sequence[Any]]:
        """Codes by kind of event."""
        ...

    def absinfo(self, axis_num: int) -> Any:
        """Value, min and max of an axis."""
        ...

    def active_keys(self) -> Sequence[int]:
        """Codes of the buttons that are pressed."""
        ...


def read_pad(device: Device) -> PadState:
    """The state of a gamepad now.

    Raises:
        RledError: it was unplugged.
    """
    try:
        pressed = set(device.active_keys())
        axes = _axes_of(device)
        return PadState(
            tuple(_deflection(device, code) if code in axes else 0.0 for code in AXES),
            tuple(code in pressed for code in BUTTONS),
        )
    except OSError as error:
        raise RledError(f"the gamepad {device.name} is gone: {error.strerror}", "", REMEDY) from None


def open_pad(path: str) -> Device:
    """Open a device, the first gamepad that there is when ``path`` is ``auto``.

    Raises:
        RledError: there is none, it may not be read, or evdev is not installed.
    """
    try:
        import evdev  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        raise RledError("the library evdev is not installed", "", "pip install evdev-binary") from None
    try:
        found = [evdev.InputDevice(each) for each in (evdev.list_devices() if path == "auto" else [path])]
    except OSError as error:
        raise RledError(f"{path} cannot be read: {error.strerror}", "a device in /dev/input", REMEDY) from None
    pads: list[Device] = [device for device in found if is_gamepad(device)]
    if not pads:
        raise RledError(f"no gamepad at {path}", "a device in /dev/input that this user may read", REMEDY)
    return pads[0]


def is_gamepad(device: Device) -> bool:
    """Whether a device has a gamepad's buttons and sticks."""
    keys = device.capabilities().get(EV_KEY, ())
    return any(FIRST_BUTTON <= code <= LAST_BUTTON for code in keys) and bool(_axes_of(device))


def _axes_of(device: Device) -> set[int]:
    entries = device.capabilities().get(EV_ABS, ())
    return {entry[0] if isinstance(entry, tuple) else entry for entry in entries}


def _deflection(device: Device, code: int) -> float:
    """Deflection of an axis, -1 to 1; left and up are positive as in joy_node."""
    info = device.absinfo(code)
    middle, reach = (info.max + info.min) / 2.0, max((info.max - info.min) / 2.0, 0.5)
    return -float(max(-1.0, min(1.0, (info.value - middle) / reach)))
