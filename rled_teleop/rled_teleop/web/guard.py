"""The gate in front of viser's server, which has no permissions and no limits of its own.

Viser calls ``websockets.asyncio.server.serve`` once. Here that call is given more: each request is judged before a page
or a WebSocket is served, connections are counted, and each is read at a limited rate, so that a flood waits in its
sender's network and not in this process.
"""

import asyncio
import contextlib
import io
import logging
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from typing import Any

import websockets.asyncio.server as websocket_server
from rled_msgs_py.errors import RledError
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from rled_teleop.web.access import Access

MOST_CONNECTIONS = 12
MESSAGE_RATE, BURST = 200.0, 200.0
"""Messages a second that are read of one connection in the long run, and how many at once."""
MESSAGE_SIZE = 256 * 1024
"""Longest message (bytes); a page sends some hundred."""
PING, SILENCE = 1.0, 3.0
"""Seconds between pings, and until a peer that does not answer them is gone."""
NO_FRAMES = {"X-Frame-Options": "DENY", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff"}

Hook = Callable[[ServerConnection, Request], Any]


class Allowance:
    """So many messages at once, and so many a second in the long run."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._then = burst, 0.0

    def wait(self, now: float) -> float:
        """Spend one message at a time (s); return how long (s) it has to wait."""
        self._left = min(self._burst, self._left + (now - self._then) * self._rate) - 1.0
        self._then = now
        return max(0.0, -self._left / self._rate)


class Throttled(ServerConnection):
    """A connection that is read at a limited rate."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._allowance = Allowance(MESSAGE_RATE, BURST)

    async def recv(self, decode: bool | None = None) -> Any:
        """Receive the next message, when it is due."""
        message = await super().recv(decode)
        if pause := self._allowance.wait(time.monotonic()):
            await asyncio.sleep(pause)
        return message


def judged(access: Access, serve_page: Hook | None, connection: ServerConnection, request: Request) -> Any:
    """What is answered to a request: a refusal, or whatever the page's own server answers."""
    verdict = access.verdict(request.path, request.headers)
    if not verdict.allowed:
        return _answer(connection, HTTPStatus.FORBIDDEN, verdict.reason)
    if verdict.cookie:
        response = _answer(connection, HTTPStatus.SEE_OTHER, "")
        response.headers["Location"] = "/"
        response.headers["Set-Cookie"] = f"{verdict.cookie}; Path=/; HttpOnly; SameSite=Strict"
        return response
    if _is_websocket(request) and len(connection.server.connections) >= MOST_CONNECTIONS:
        return _answer(connection, HTTPStatus.SERVICE_UNAVAILABLE, "too many visitors")
    response = serve_page(connection, request) if serve_page else None
    if isinstance(response, Response):
        response.headers.update(NO_FRAMES)
    return response


def _is_websocket(request: Request) -> bool:
    return str(request.headers.get("Upgrade", "")).lower() == "websocket"


def _answer(connection: ServerConnection, status: HTTPStatus, text: str) -> Response:
    response = connection.respond(status, f"{text}\n")
    response.headers.update(Headers(NO_FRAMES))
    return response


@contextmanager
def guarded(access: Access) -> Iterator[None]:
    """Have the server that is started inside the block ask for permission.

    Raises:
        RledError: none was started the way that is guarded here; better no page than an open one.
    """
    original, called = websocket_server.serve, []

    def serve(handler: Any, *arguments: Any, process_request: Hook | None = None, **options: Any) -> Any:
        called.append(True)
        limits = {"max_size": MESSAGE_SIZE, "ping_interval": PING, "ping_timeout": SILENCE, "logger": _quiet()}
        hook = partial(judged, access, process_request)
        return original(handler, *arguments, process_request=hook, create_connection=Throttled, **{**options, **limits})

    websocket_server.serve = serve
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # viser's banner names an address without the token
            yield
    finally:
        websocket_server.serve = original
    if not called:
        raise RledError("this version of viser starts its server in another way", "the one in requirements.lock")


def _quiet() -> logging.Logger:
    """A log of nothing: whoever opens a connection and says nothing, as browsers do, is no news."""
    logger = logging.getLogger("rled_teleop.web")
    logger.setLevel(logging.CRITICAL + 1)
    return logger


def require_free(host: str, port: int) -> None:
    """Refuse a port that is taken; viser would take the next one without a word.

    Raises:
        RledError: it is, or there is no such address here.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with contextlib.closing(socket.socket(family)) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise RledError(f"no page at {host} port {port}: {error.strerror}", "", "give another --port") from None
