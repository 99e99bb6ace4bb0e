"""The head of a request to the page, as websockets reads it and the page's gate judges it."""

from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import viser
from rled_teleop.web.access import Access
from rled_teleop.web.protection import judged
from websockets.http11 import Request
from websockets.server import ServerProtocol

from ..mutators.texts import mutate_lines as mutate

__all__ = ["REFUSALS", "mutate", "read", "seeds"]

TOKEN = "correct-horse-battery"
COOKIE = Access(TOKEN)._cookie()
REFUSALS = ()
HEADS = (
    ["GET / HTTP/1.1", "Host: localhost:8080", "Accept: text/html", f"Cookie: a=b; {COOKIE}; c=d"],
    [f"GET /?token={TOKEN} HTTP/1.1", "Host: 127.0.0.1:8080", "Origin: http://127.0.0.1:8080"],
    [
        "GET / HTTP/1.1",
        "Host: [::1]:8080",
        "Origin: http://[::1]:8080",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
    ],
)


def seeds() -> list[bytes]:
    return ["\r\n".join([*head, "", ""]).encode() for head in HEADS]


class Connection:
    """Of websockets' connection what the gate asks for."""

    class server:
        connections = ()

    def __init__(self) -> None:
        self.respond = ServerProtocol().reject


def served(connection: Connection, _: Any) -> Any:
    return connection.respond(200, "page")


def read(data: bytes, _: Path) -> None:
    protocol = ServerProtocol()
    protocol.receive_data(data)
    protocol.receive_eof()
    for request in filter(lambda event: isinstance(event, Request), protocol.events_received()):
        for access, knows in (
            (Access(), False),
            (Access(TOKEN), TOKEN in unquote_to_bytes(data).decode(errors="replace") or COOKIE.encode() in data),
        ):
            response = judged(access, served, Connection(), request)
            status = response.status_code if response else 101  # a WebSocket is opened
            assert status in (101, 200, 303, 503) or 400 <= status < 500, f"status {status}"
            assert not access.token or knows or status >= 400, "a page without the token"
