"""The gate in front of the page, asked by plain HTTP and WebSocket clients; no browser, no robot."""

import http.client
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from threading import Thread
from typing import Any

import msgspec.msgpack
import pytest
import viser
from rled_msgs_py.processes import program
from rled_teleop.web.connection import BURST, MESSAGE_RATE
from rled_teleop.web.protection import MAX_CONNECTIONS
from viser import _messages as messages
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

TOKEN = "correct-horse-battery"
SAME = [f"viser-v{viser.__version__}"]


@pytest.fixture(scope="module")
def address(ros_domain: int, serve: Callable[..., Any]) -> Iterator[str]:
    with serve("--token", TOKEN) as address:
        yield address


def get(address: str, target: str = "/", **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection(address.removeprefix("http://"), timeout=20)
    connection.request("GET", target, headers=headers)
    return connection.getresponse()


@pytest.fixture(scope="module")
def cookie(address: str) -> str:
    answer = get(address, f"/?token={TOKEN}")
    assert answer.status == 303
    assert answer.headers["Location"] == "/"
    assert "HttpOnly" in answer.headers["Set-Cookie"]
    assert "SameSite=Strict" in answer.headers["Set-Cookie"]
    return answer.headers["Set-Cookie"].partition(";")[0]


def open_socket(address: str, **headers: str) -> ClientConnection:
    return connect(
        address.replace("http", "ws"), additional_headers=headers, subprotocols=SAME, max_size=None, compression=None
    )


HOST, GET = b"Host: localhost\r\n", b"GET / HTTP/1.1\r\n"
MALFORMED = {
    b"GET /\r\n\r\n": 400,
    b"GET / HTTP/1.0\r\n" + HOST + b"\r\n": 400,
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n": 400,
    b"POST / HTTP/1.1\r\n" + HOST + b"Content-Length: 3\r\n\r\nabc": 400,
    b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n": 400,
    b"GET / HTTP/1.1\n" + HOST + b"\n": 400,
    b"GET  /  HTTP/1.1\r\n" + HOST + b"\r\n": 400,
    b"GET /%zz HTTP/1.1\r\n" + HOST + b"\r\n": 400,
    b"GET /%00 HTTP/1.1\r\n" + HOST + b"\r\n": 400,
    b"GET /\xff HTTP/1.1\r\n" + HOST + b"\r\n": 400,
    b"GET /" + b"a" * 3000 + b" HTTP/1.1\r\n" + HOST + b"\r\n": 414,
    b"GET /" + b"a" * 30000 + b" HTTP/1.1\r\n" + HOST + b"\r\n": 431,
    GET + b"\r\n": 400,
    GET + HOST + HOST + b"\r\n": 400,
    GET + b"Host: [::1\r\n\r\n": 400,
    GET + b"Host: \xc3\xb6\r\n\r\n": 400,
    GET + HOST + b"Origin: http://[::1\r\n\r\n": 400,
    GET + HOST + b"Cookie: a=\xff\r\n\r\n": 400,
    GET + HOST + b"Cookie: a=\0\r\n\r\n": 400,
    GET + HOST + b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n": 400,
    GET + HOST + b"Content-Length: 5\r\n\r\nhello": 400,
    GET + HOST + b"Content-Length: 0\r\nContent-Length: 0\r\n\r\n": 400,
    GET + HOST + b"no colon\r\n\r\n": 400,
    GET + HOST + b"X: " + b"a" * 2_000_000 + b"\r\n\r\n": 431,
    GET + HOST + b"X: a\r\n" * 300 + b"\r\n": 431,
    GET + HOST + b"Upgrade: websocket\r\nUpgrade: h2c\r\n\r\n": 403,
    GET + HOST + b"Accept-Encoding: gzip\r\nAccept-Encoding: br\r\n\r\n": 403,
}


def test_malformed_requests_are_answered(address: str) -> None:
    host, port = address.removeprefix("http://").split(":")
    for request_bytes, status in MALFORMED.items():
        with socket.create_connection((host, int(port)), 20.0) as opened:
            with suppress(OSError):  # it may be refused before it has been sent
                opened.sendall(request_bytes)
            answer = opened.makefile("rb").readline().split()
        assert answer[:2] == [b"HTTP/1.1", str(status).encode()], request_bytes[:60]


def test_wrong_token_is_refused(address: str) -> None:
    for target in ("/", "/?token=wrong-horse-battery", "/index.html", "/..%2f..%2fsetup.py"):
        answer = get(address, target)
        assert answer.status == 403
        assert b"<html" not in answer.read()


def test_right_token_is_served_the_page_that_no_site_can_frame(address: str, cookie: str) -> None:
    answer = get(address, "/", Cookie=cookie)
    assert answer.status == 200
    assert b"<html" in answer.read()
    assert answer.headers["X-Frame-Options"] == "DENY"


@pytest.mark.parametrize("headers", [{}, {"Cookie": "rled_teleop_web=00"}], ids=["no cookie", "wrong cookie"])
def test_socket_without_the_cookie_is_refused(address: str, headers: dict[str, str]) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        open_socket(address, **headers)


def test_socket_of_another_site_is_refused(address: str, cookie: str) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        open_socket(address, Cookie=cookie, Origin="http://evil.example")


def test_more_connections_than_allowed_are_refused(address: str, cookie: str) -> None:
    opened = [open_socket(address, Cookie=cookie) for _ in range(MAX_CONNECTIONS)]
    with pytest.raises(InvalidStatus, match="503"):
        open_socket(address, Cookie=cookie)
    for each in opened:
        each.close()


def test_a_flood_is_read_at_the_allowed_rate_and_the_page_still_answers(address: str, cookie: str) -> None:
    text = messages.LocalStorageGetItemResponseMessage(value="x" * 900, error=None, request_uuid="none")
    data = msgspec.msgpack.encode(text.as_serializable_dict([]))
    flood, sent = open_socket(address, Cookie=cookie), []

    def pour() -> None:
        with suppress(ConnectionClosed):
            while True:
                flood.send(data)
                sent.append(time.monotonic())

    def read() -> None:
        with suppress(ConnectionClosed):
            for _ in flood:
                pass

    pouring, reading = Thread(target=pour, daemon=True), Thread(target=read, daemon=True)
    began, slowest = time.monotonic(), 0.0
    reading.start()
    pouring.start()
    while time.monotonic() - began < 4.0:
        asked = time.monotonic()
        assert get(address, "/", Cookie=cookie).status == 200
        slowest = max(slowest, time.monotonic() - asked)
    seconds = time.monotonic() - began
    with suppress(OSError):  # closed already, where the page has cut it off
        flood.socket.shutdown(socket.SHUT_RDWR)
    pouring.join(10.0)
    reading.join(10.0)
    print(f"flood: {len(sent)} messages in {seconds:.1f} s, slowest page {slowest:.2f} s")
    buffered = 12e6 / len(data)  # what Linux lets both ends' sockets hold, which is memory of nobody's process
    assert 0 < len(sent) <= BURST + MESSAGE_RATE * seconds + buffered
    assert slowest < 5.0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--host", "0.0.0.0"], "open to everybody"),
        (["--host", "0.0.0.0", "--token", "short"], "12 or more"),
        (["--host", "203.0.113.7", "--token", TOKEN], "no page at 203.0.113.7"),
    ],
)
def test_mistake_is_one_line(ros_domain: int, options: list[str], said: str) -> None:
    ended = subprocess.run(
        [*program("rled_teleop", "teleop_web"), *options], capture_output=True, text=True, timeout=90
    )
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: ")
    assert said in ended.stderr
    assert ended.stderr.count("\n") == 1


def test_page_of_a_taken_port_is_refused(address: str) -> None:
    command = [*program("rled_teleop", "teleop_web"), "--port", address.rpartition(":")[2]]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=90)
    assert ended.returncode == 2
    assert ended.stderr.startswith("error: no page at 127.0.0.1 port")
    assert ended.stderr.count("\n") == 1
