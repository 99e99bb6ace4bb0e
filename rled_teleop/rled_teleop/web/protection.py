"""The gate in front of viser's server, which has no permissions and no limits of its own.

Viser calls ``websockets.asyncio.server.serve`` once. Here that call is given more: each request is judged before a page
or a WebSocket is served, connections are counted, and of each only what the page understands is read, at a limited
rate, so that a flood waits in its sender's network and not in this process.
"""

import contextlib
import io
import logging
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from typing import Any
from urllib.parse import quote

import viser
import websockets.asyncio.server as websocket_server
from rled_msgs_py.errors import RledError
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from rled_teleop.web.access import Access
from rled_teleop.web.connection import ProtectedConnection
from rled_teleop.web.inbound import MAX_MESSAGE_SIZE
from rled_teleop.web.request import BadRequest, PageRequest, read_request

MAX_CONNECTIONS = 12
PING_PERIOD, PING_TIMEOUT, CLOSE_TIMEOUT = 1.0, 3.0, 2.0
"""Seconds between pings, until a peer that does not answer them is gone, and until one that is to go has to be."""
PROTOCOL = f"viser-v{viser.__version__}"
NO_FRAMES = {"X-Frame-Options": "DENY", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff"}

Hook = Callable[[ServerConnection, Request], Any]


def judged(access: Access, serve_page: Hook, connection: ServerConnection, request: Request) -> Any:
    """What is answered to a request: a refusal, or whatever the page's own server answers."""
    try:
        asked = read_request(request.path, request.headers)
    except BadRequest as error:
        return _answer(connection, error.status, str(error))
    verdict = access.verdict(asked)
    if not verdict.allowed:
        return _answer(connection, HTTPStatus.FORBIDDEN, verdict.reason)
    if verdict.cookie:
        response = _answer(connection, HTTPStatus.SEE_OTHER, "")
        response.headers["Location"] = "/"
        response.headers["Set-Cookie"] = f"{verdict.cookie}; Path=/; HttpOnly; SameSite=Strict"
        return response
    if asked.is_socket:
        return _refused_socket(asked, connection)
    response = serve_page(connection, Request(quote(asked.path), Headers({"Accept-Encoding": asked.encodings})))
    response.headers.update(NO_FRAMES)
    return response


def _refused_socket(asked: PageRequest, connection: ServerConnection) -> Response | None:
    """Why a WebSocket is not served; None if it is."""
    if asked.protocols != (PROTOCOL,):
        return _answer(connection, HTTPStatus.BAD_REQUEST, f"this page speaks {PROTOCOL}: open it anew")
    if len(connection.server.connections) >= MAX_CONNECTIONS:
        return _answer(connection, HTTPStatus.SERVICE_UNAVAILABLE, "too many visitors")
    return None


def _answer(connection: ServerConnection, status: HTTPStatus, text: str) -> Response:
    response = connection.respond(status, f"{text}\n")
    response.headers.update(Headers(NO_FRAMES))
    return response


@contextmanager
def protected(access: Access) -> Iterator[None]:
    """Have the server that is started inside the block ask for permission.

    Raises:
        RledError: none was started the way that is protected here; better no page than an open one.
    """
    original, called = websocket_server.serve, []

    def serve(handler: Any, *arguments: Any, process_request: Hook, **options: Any) -> Any:
        called.append(True)
        limits = {
            "max_size": MAX_MESSAGE_SIZE,
            "ping_interval": PING_PERIOD,
            "ping_timeout": PING_TIMEOUT,
            "close_timeout": CLOSE_TIMEOUT,
        }
        options |= limits | {"create_connection": ProtectedConnection, "logger": _quiet(), "server_header": None}
        return original(handler, *arguments, process_request=partial(judged, access, process_request), **options)

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
