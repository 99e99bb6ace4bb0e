"""Visitors and strangers who want the page's memory: not read, or cut off, and what they took is given back."""

import dataclasses
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from typing import Any

import msgspec.msgpack
import pytest
from rled_teleop.web.connection import MAX_SOCKETS
from rled_teleop.web.protection import MAX_CONNECTIONS, PROTOCOL
from viser import _messages as messages
from websockets.exceptions import ConnectionClosed
from websockets.frames import Opcode

from .conftest import await_that
from .processes import one_with, resident
from .socket_visitor import SocketVisitor
from .test_inbound import CAMERA

WEBSOCKET = (
    "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    f"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: {PROTOCOL}\r\n\r\n"
)
MORE = 12.0
"""By how much (MB) memory may differ after what is done a second time."""


@pytest.fixture(scope="module")
def address(ros_domain: int, serve: Callable[..., Any]) -> Iterator[str]:
    with serve() as address:
        yield address


@pytest.fixture
def connect(address: str) -> Iterator[Callable[[], socket.socket]]:
    """Opens plain sockets, with little room for what they are sent."""
    host, port = address.removeprefix("http://").split(":")
    with ExitStack() as stack:

        def opened() -> socket.socket:
            made = stack.enter_context(closing(socket.socket()))
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            made.settimeout(10.0)
            made.connect((host, int(port)))
            return made

        yield opened


@pytest.fixture
def websocket(connect: Callable[[], socket.socket]) -> Callable[[], socket.socket]:
    """Opens WebSockets that no library is at the other end of."""

    def opened() -> socket.socket:
        made = connect()
        made.sendall(WEBSOCKET.encode())
        assert made.recv(12) == b"HTTP/1.1 101"
        return made

    return opened


def frame(opcode: Opcode, data: bytes = b"", last: bool = True) -> bytes:
    length = bytes([0x80 | len(data)]) if len(data) < 126 else struct.pack(">BH", 0xFE, len(data))
    return bytes([0x80 * last | opcode]) + length + b"\0\0\0\0" + data


def is_cut(opened: socket.socket) -> bool:
    """Whether the other end has hung up; reads nothing that is not there yet."""
    try:
        opened.send(frame(Opcode.PONG))
        return opened.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def pour(opened: socket.socket, data: bytes, seconds: float) -> None:
    end = time.monotonic() + seconds
    with suppress(OSError):
        while time.monotonic() < end:
            opened.sendall(data)


def ends(opened: socket.socket) -> bool:
    """Read to the end."""
    try:
        while opened.recv(65536):
            pass
    except TimeoutError:
        return False
    except OSError:
        pass
    return True


def test_pieces_of_messages_are_cut_off(websocket: Callable[[], socket.socket]) -> None:
    for first, rest in ((Opcode.BINARY, b""), (Opcode.TEXT, b"x")):
        opened = websocket()
        pour(opened, frame(first, rest, last=False) + frame(Opcode.CONT, rest, last=False) * 100, 1.0)
        assert ends(opened)


def test_a_flood_of_pings_is_cut_off(websocket: Callable[[], socket.socket]) -> None:
    opened = websocket()
    pour(opened, frame(Opcode.PING, b"x" * 125) * 50, 5.0)
    assert ends(opened)


def test_a_message_longer_than_any_of_the_page_ends_the_connection(websocket: Callable[[], socket.socket]) -> None:
    for size in (5_000, 60_000):
        opened = websocket()
        opened.sendall(frame(Opcode.BINARY, b"x" * size))
        assert ends(opened)


def test_who_reads_nothing_is_cut_off(websocket: Callable[[], socket.socket]) -> None:
    opened = [websocket() for _ in range(4)]
    for each in opened:
        each.sendall(frame(Opcode.BINARY, msgspec.msgpack.encode(CAMERA.as_serializable_dict([]))))
    await_that(lambda: all(map(is_cut, opened)), "the page to hang up", timeout=30.0)


def test_who_stops_in_the_middle_of_a_page_is_cut_off(connect: Callable[[], socket.socket]) -> None:
    opened = connect()
    opened.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    await_that(lambda: is_cut(opened) or opened.recv(1) == b"", "the page to hang up", timeout=30.0)


def test_silent_strangers_are_no_more_than_so_many(connect: Callable[[], socket.socket], address: str) -> None:
    opened = [connect() for _ in range(3 * MAX_SOCKETS)]
    await_that(lambda: sum(map(is_cut, opened)) >= 2 * MAX_SOCKETS, "the page to hang up")
    for each in opened:
        each.close()
    with closing(await_that(lambda: visits(address), "a visit")) as visitor:
        visitor.find("EMERGENCY STOP")


def visits(address: str) -> SocketVisitor | None:
    with suppress(OSError, ConnectionClosed, ConnectionError, EOFError):
        return SocketVisitor(address)
    return None


def forms(address: str) -> None:
    """What filled the page's memory: each with an id of its own is kept by viser for whoever comes later."""
    for size in (3_000, 200_000):
        with closing(SocketVisitor(address)) as visitor, suppress(ConnectionClosed):
            for number in range(300):
                visitor.send(messages.GuiFormDirtyMessage(f"{number}" + "x" * size))
                visitor.send(messages.GuiFormSubmitMessage(f"{number}" + "x" * size))
            visitor.find("EMERGENCY STOP")


def kinds(address: str) -> None:
    """Everything that viser's protocol has."""
    with closing(SocketVisitor(address)) as visitor, suppress(ConnectionClosed):
        for kind in messages.Message.get_subclasses():
            for value in ("x" * 300, [1.0] * 30, {"a": None}):
                fields = {field.name: value for field in dataclasses.fields(kind)}
                data = msgspec.msgpack.encode(fields | {"type": kind.__name__})
                if len(data) < 4000:
                    visitor.send_raw(data)
        visitor.find("EMERGENCY STOP")


def arrivals(address: str) -> None:
    for _ in range(40):
        with closing(SocketVisitor(address)) as visitor:
            visitor.find("EMERGENCY STOP")


def crowd(address: str) -> None:
    with ExitStack() as stack:
        visitors = [stack.enter_context(closing(SocketVisitor(address))) for _ in range(MAX_CONNECTIONS)]
        for each in visitors:
            each.find("EMERGENCY STOP")


@pytest.mark.parametrize("attack", [forms, kinds, arrivals, crowd], ids=lambda attack: attack.__name__)
def test_memory_is_given_back(address: str, attack: Callable[[str], None]) -> None:
    page = one_with("teleop_web", address.rpartition(":")[2])
    attack(address)
    await_that(lambda: visits(address), "a visit").close()
    before = resident(page)
    attack(address)
    await_that(lambda: visits(address), "a visit").close()
    after = resident(page)
    print(f"{attack.__name__}: {before:.1f} MB, then {after:.1f} MB")
    assert after - before < MORE
