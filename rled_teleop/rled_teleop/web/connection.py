"""A visitor's connection: what of it is read, how fast, and for how long it may not read."""

import asyncio
import math
import time
from http import HTTPStatus
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import InvalidMessage, SecurityError
from websockets.frames import Frame, Opcode

from rled_teleop.web.inbound import understood

MAX_SOCKETS = 64
"""Open sockets, of whatever kind; a browser has six at most."""
MESSAGE_RATE, BURST = 200.0, 200.0
"""Messages a second that are read of one connection in the long run, and how many at once."""
CONTROL_RATE, CONTROL_BURST = 10.0, 50.0
"""Pings and the like; a browser sends one for each that it gets."""
CHUNK = 16 * 1024
"""Bytes that are read at once, so that a flood of small messages is noticed early."""
STALL_TIMEOUT = 5.0
"""A peer that has taken nothing in so long a time of what waits for it is gone (s)."""
LINGER_TIME = 1.0
"""So long a peer may go on sending what is not read, so that it hears why (s)."""


class RateLimiter:
    """So many messages at once, and so many a second in the long run."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._then = burst, 0.0

    def wait(self, now: float) -> float:
        """Spend one message at a time (s); return how long (s) it has to wait."""
        self._left = min(self._burst, self._left + (now - self._then) * self._rate) - 1.0
        self._then = now
        return max(0.0, -self._left / self._rate)


class ProtectedConnection(ServerConnection):
    """A connection that is read at a limited rate, and only what the page understands; a malformed request is answered.

    A peer that sends what no browser does (pieces of messages, a flood of pings), or does not take what is sent to it,
    is cut off: both would be memory of this process.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._messages = RateLimiter(MESSAGE_RATE, BURST)
        self._controls = RateLimiter(CONTROL_RATE, CONTROL_BURST)
        self._is_answered = False
        self._watching: asyncio.Handle | None = None

    async def recv(self, decode: bool | None = None) -> Any:
        """Receive the next message that is understood, when it is due."""
        while True:
            message = await super().recv(decode)
            if pause := self._messages.wait(time.monotonic()):
                await asyncio.sleep(pause)
            if (passed := understood(message)) is not None:
                return passed

    async def handshake(self, *arguments: Any, **options: Any) -> None:
        """Perform the opening handshake; a peer that was told of a mistake may read it before it is cut off."""
        try:
            await super().handshake(*arguments, **options)
        except InvalidMessage:
            await asyncio.wait([self.connection_lost_waiter], timeout=LINGER_TIME)
            raise

    def send_data(self) -> None:
        """Write what is to be sent; to what is no request, what is wrong about it."""
        error = self.protocol.handshake_exc
        if isinstance(error, InvalidMessage) and not self._is_answered:
            self._is_answered = True
            self.transport.write(_complaint(is_too_long=isinstance(error.__cause__, SecurityError)))
        super().send_data()

    def process_event(self, event: Any) -> None:
        """Take a request or a frame."""
        if isinstance(event, Frame) and not self._is_usual(event):
            self.transport.abort()
            return
        super().process_event(event)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to serve, unless too many are served."""
        super().connection_made(transport)
        self.transport.max_size = CHUNK
        if len(self.server.handlers) > MAX_SOCKETS:
            self.transport.abort()

    def pause_writing(self) -> None:
        """Much waits to be taken by the peer; all who write wait too, once each has written what it had."""
        super().pause_writing()
        self._watch(math.inf)

    def resume_writing(self) -> None:
        """Most has been taken."""
        super().resume_writing()
        self._end_watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """It is over."""
        super().connection_lost(exc)
        self._end_watch()

    def _watch(self, before: float) -> None:
        self._watching = self.loop.call_later(STALL_TIMEOUT, self._check_progress, before)

    def _end_watch(self) -> None:
        if self._watching is not None:
            self._watching.cancel()

    def _check_progress(self, before: float) -> None:
        waiting = self.transport.get_write_buffer_size()
        if waiting >= before:
            self.transport.abort()
        else:
            self._watch(waiting)

    def _is_usual(self, frame: Frame) -> bool:
        if frame.opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
            return frame.fin and frame.opcode is not Opcode.CONT
        return self._controls.wait(time.monotonic()) == 0.0


def _complaint(is_too_long: bool) -> bytes:
    """The answer to what could not be read as a request."""
    status = HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE if is_too_long else HTTPStatus.BAD_REQUEST
    text = f"{status.phrase}\n"
    head = f"HTTP/1.1 {status.value} {status.phrase}", f"Content-Length: {len(text)}", "Connection: close"
    return ("\r\n".join((*head, "Content-Type: text/plain", "", text))).encode()
