"""Who gets the page at all: decided for each request, before anything is served."""

import hashlib
import hmac
from dataclasses import dataclass
from ipaddress import ip_address
from typing import NamedTuple

from rled_msgs_py.errors import RledError

from rled_teleop.web.request import PageRequest

MIN_TOKEN_LENGTH = 12
COOKIE = "rled_teleop_web"


class Verdict(NamedTuple):
    """What becomes of a request.

    Attributes:
        allowed: it is served.
        reason: why it is not.
        cookie: to be set before the browser asks again without the token in its address; empty for none.
    """

    allowed: bool
    reason: str = ""
    cookie: str = ""


@dataclass(frozen=True)
class Access:
    """The rules.

    Without a token only a page that was called by a name of this machine is served, so that no web site can reach it
    by a name of its own (DNS rebinding). A WebSocket that another site opens is refused, with a token or without.

    Attributes:
        token: the word that opens the page; empty for none.
    """

    token: str = ""

    def verdict(self, request: PageRequest) -> Verdict:
        """Judge a request."""
        if request.is_socket and request.origin is not None and request.origin != request.host:
            return Verdict(False, "this WebSocket was opened by another site")
        if not self.token:
            name = request.name
            return Verdict(True) if is_loopback(name) else Verdict(False, f"called as '{name}', not as localhost")
        if request.tokens:
            right = _same(request.tokens[-1], self.token)
            return Verdict(right, "" if right else "wrong token", self._cookie() if right else "")
        if any(_same(each, self._cookie()) for each in request.cookies):
            return Verdict(True)
        return Verdict(False, "open the page with ?token=WORD, the word that it was started with")

    def _cookie(self) -> str:
        return f"{COOKIE}={hashlib.sha256(self.token.encode()).hexdigest()}"


def _same(given: str, right: str) -> bool:
    """Compare in a time that tells nothing."""
    return hmac.compare_digest(given.encode(), right.encode())


def is_loopback(name: str) -> bool:
    """Whether a host name or address means this machine alone."""
    if name == "localhost":
        return True
    try:
        return ip_address(name).is_loopback
    except ValueError:
        return False


def access_for(host: str, token: str) -> Access:
    """The rules for a page bound to an address.

    Raises:
        RledError: it would be open to other machines without a token, or the token is easily guessed.
    """
    if not token and not is_loopback(host):
        raise RledError(
            f"the page would be open to everybody at {host}", "", "give --token-file FILE, or --host 127.0.0.1"
        )
    if token and len(token) < MIN_TOKEN_LENGTH:
        raise RledError(
            f"a token of {len(token)} characters", f"{MIN_TOKEN_LENGTH} or more", "try: openssl rand -hex 16"
        )
    return Access(token)
