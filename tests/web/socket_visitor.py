"""A visitor without a browser: speaks viser's protocol over a plain WebSocket, and may lie."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import msgspec.msgpack
import viser
import zstandard
from viser import _messages as messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

HOLD_RATE = 20.0


def unpacked(data: bytes) -> list[dict[str, Any]]:
    """The messages of one frame: two lengths, compressed msgpack, binary arrays (which are left out)."""
    length = int.from_bytes(data[8:16], "little")
    return list(msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + length]))["messages"])


def _awaited(look: Callable[[], Any], what: str) -> Any:
    deadline = time.monotonic() + 30.0
    while not (found := look()):
        assert time.monotonic() < deadline, f"no {what} on the page"
        time.sleep(0.02)
    return found


class SocketVisitor:
    """Reads all that is sent, answers when asked whether it is alive, and presses buttons by their labels."""

    def __init__(self, address: str) -> None:
        name = f"viser-v{viser.__version__}"
        self._socket = connect(address.replace("http", "ws"), subprotocols=[name], max_size=None, compression=None)
        self._elements: dict[str, dict[str, Any]] = {}
        self._owners: dict[str, str] = {}
        self.received: Counter[str] = Counter()
        self.alive = True
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()
        camera = messages.ViewerCameraMessage((1, 0, 0, 0), (1, 1, 1), 0.8, 0.01, 100.0, 600, 800, (0, 0, 0), (0, 0, 1))
        self.send(camera)

    def send(self, message: Any) -> None:
        self.send_raw(msgspec.msgpack.encode(message.as_serializable_dict([])))

    def send_raw(self, data: bytes) -> None:
        """Send bytes that no message may be made of."""
        self._socket.send(data)

    def _read(self) -> None:
        with suppress(ConnectionClosed):
            for data in self._socket:
                for message in unpacked(bytes(data)):
                    self._take(message)

    def _take(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        self.received[kind] += 1
        if kind == "TransformControlsMessage":
            self._owners[message["name"]] = message["owner"]
        if "uuid" in message and isinstance(message.get("props"), dict):
            self._elements[message["uuid"]] = {"value": message.get("value"), **message["props"]}
        elif kind == "GuiUpdateMessage" and message["uuid"] in self._elements:
            self._elements[message["uuid"]].update(message["updates"])
        elif kind == "LocalStorageGetItemRequestMessage" and self.alive:
            answer = messages.LocalStorageGetItemResponseMessage(None, None, message["request_uuid"])
            with suppress(ConnectionClosed):
                self.send(answer)

    def find(self, label: str) -> str:
        """The newest element of that label."""

        def found() -> str:
            newest_first = reversed(list(self._elements.items()))
            return next((uuid for uuid, props in newest_first if props.get("label") == label), "")

        return str(_awaited(found, label))

    def enter(self, label: str, value: float | str) -> None:
        """Set a slider, a number or a choice."""
        self.send(messages.GuiUpdateMessage(self.find(label), {"value": value}))

    def value(self, label: str) -> Any:
        """What a control shows."""
        return self._elements[self.find(label)]["value"]

    def drag(self, *point: float, handle: str = "/handle") -> None:
        """Take a handle, by default the one at the tool, to a point (m) and keep it there."""
        owner = _awaited(lambda: self._owners.get(handle), handle)
        self.send(messages.TransformControlsDragStartMessage(handle, owner))
        self.send(messages.TransformControlsUpdateMessage(handle, (1.0, 0.0, 0.0, 0.0), point, owner))

    def is_disabled(self, label: str) -> bool:
        return bool(self._elements[self.find(label)]["disabled"])

    def text(self) -> str:
        """All texts of the page."""
        parts = (each.get(key, "") for each in list(self._elements.values()) for key in ("content", "_markdown"))
        return "\n".join(map(str, parts))

    def labels(self) -> set[str]:
        """Labels of all that is visible."""
        return {str(each["label"]) for each in list(self._elements.values()) if each.get("label") and each["visible"]}

    def colours(self) -> set[str]:
        """Colours of all buttons."""
        return {str(each["color"]) for each in list(self._elements.values()) if each.get("color")}

    def plots(self) -> set[str]:
        """Titles of the plots that are visible."""
        return {str(each["title"]) for each in list(self._elements.values()) if each.get("title") and each["visible"]}

    def click(self, label: str) -> None:
        self.send(messages.GuiUpdateMessage(self.find(label), {"value": True}))

    def press(self, group: str, choice: str) -> None:
        self.send(messages.GuiUpdateMessage(self.find(group), {"value": choice}))

    def may_drive(self) -> bool:
        return not self.is_disabled("Drive")

    def hold_once(self, label: str) -> None:
        self.send(messages.GuiButtonHoldMessage(self.find(label), HOLD_RATE))

    @contextmanager
    def holding(self, label: str) -> Iterator[None]:
        """Hold a button, as a browser does."""
        stop = threading.Event()

        def hold() -> None:
            while not stop.is_set():
                self.hold_once(label)
                stop.wait(1.0 / HOLD_RATE)

        holder = threading.Thread(target=hold, daemon=True)
        holder.start()
        try:
            yield
        finally:
            stop.set()
            holder.join()

    def begin_flood(self, message: Any) -> None:
        """Send one message as often as the network takes it, until closed."""

        def pour() -> None:
            with suppress(ConnectionClosed, OSError):
                while True:
                    self.send(message)

        threading.Thread(target=pour, daemon=True).start()

    def close(self) -> None:
        self._socket.close()
        self._reading.join(5.0)
