"""A request as the page understands it; what is malformed is told apart from what is not allowed."""

import re
from http import HTTPStatus
from ipaddress import IPv6Address
from typing import NamedTuple
from urllib.parse import unquote_to_bytes

from websockets.datastructures import Headers

MAX_PATH_LENGTH = 255
"""Bytes of a path; the files of the page have short names."""

_HOST = re.compile(r"(?:\[(?P<address>[0-9A-Fa-f:.]+)\]|(?P<name>[A-Za-z0-9._-]+))(?::(?P<port>[0-9]{1,5}))?")
_ORIGIN = re.compile(r"null|[A-Za-z][A-Za-z0-9+.-]*://(?P<host>[!-~]*)")
_VISIBLE = re.compile(r"[!-~]*")
_TEXT = re.compile(r"[\t -~]*")
_CUT_ESCAPE = re.compile(r"%(?![0-9A-Fa-f]{2})")


class BadRequest(ValueError):
    """A request that is malformed.

    Args:
        reason: what of it.
        status: to be answered.
    """

    def __init__(self, reason: str, status: HTTPStatus = HTTPStatus.BAD_REQUEST) -> None:
        super().__init__(reason)
        self.status = status


class PageRequest(NamedTuple):
    """What of a request the page looks at.

    Attributes:
        path: decoded, without the query.
        host: by which the page was called, with the port if one was named, in small letters.
        name: the host without port and brackets.
        origin: host of the site that opens a WebSocket, empty for one without; None where none is named.
        tokens: values of ``token`` in the query.
        cookies: pairs as they came.
        is_socket: a WebSocket is asked for.
        protocols: that its client speaks.
        encodings: that its client accepts.
    """

    path: str
    host: str
    name: str
    origin: str | None
    tokens: tuple[str, ...]
    cookies: tuple[str, ...]
    is_socket: bool
    protocols: tuple[str, ...]
    encodings: str


def read_request(target: str, headers: Headers) -> PageRequest:
    """Read a request.

    Args:
        target: path and query, as they came.
        headers: all of them; bytes beyond ASCII as surrogates.

    Raises:
        BadRequest: some part that the page looks at is malformed, missing or there twice.
    """
    path, _, query = target.partition("?")
    if not path.startswith("/"):
        raise BadRequest("the request names no path")
    if len(path) > MAX_PATH_LENGTH:
        raise BadRequest("the path is too long", HTTPStatus.REQUEST_URI_TOO_LONG)
    host = _one(headers, "Host")
    if host is None:
        raise BadRequest("the request has no Host")
    return PageRequest(
        path=_decoded(path),
        host=host.lower(),
        name=_host_name(host),
        origin=_origin(_one(headers, "Origin")),
        tokens=_tokens(query),
        cookies=_listed(headers, "Cookie", ";"),
        is_socket="websocket" in map(str.lower, _listed(headers, "Upgrade", ",")),
        protocols=_listed(headers, "Sec-WebSocket-Protocol", ","),
        encodings=", ".join(_listed(headers, "Accept-Encoding", ",")),
    )


def _one(headers: Headers, name: str) -> str | None:
    """The value of a header that may be there once."""
    found = headers.get_all(name)
    if len(found) > 1:
        raise BadRequest(f"the request has {len(found)} headers {name}")
    return found[0].strip() if found else None


def _listed(headers: Headers, name: str, separator: str) -> tuple[str, ...]:
    """The parts of a header that is a list, wherever it is cut in two."""
    found = separator.join(headers.get_all(name))
    if not _TEXT.fullmatch(found):
        raise BadRequest(f"the header {name} has other characters than ASCII")
    return tuple(part for each in found.split(separator) if (part := each.strip()))


def _host_name(host: str) -> str:
    found = _HOST.fullmatch(host)
    if found is None or int(found["port"] or 0) > 65535:
        raise BadRequest("the Host is malformed")
    if found["address"]:
        try:
            return str(IPv6Address(found["address"]))
        except ValueError:
            raise BadRequest("the Host is no IPv6 address") from None
    return found["name"].lower()


def _origin(origin: str | None) -> str | None:
    if origin is None:
        return None
    found = _ORIGIN.fullmatch(origin)
    if found is None or (found["host"] and not _HOST.fullmatch(found["host"])):
        raise BadRequest("the Origin is malformed")
    return (found["host"] or "").lower()


def _tokens(query: str) -> tuple[str, ...]:
    pairs = [each.partition("=") for each in query.split("&") if each]
    decoded = [(_decoded(name), _decoded(value.replace("+", " "))) for name, _, value in pairs]
    return tuple(value for name, value in decoded if name == "token")


def _decoded(text: str) -> str:
    """Undo percent-encoding, strictly."""
    if not _VISIBLE.fullmatch(text.replace(" ", "")) or _CUT_ESCAPE.search(text):
        raise BadRequest("the address is not percent-encoded")
    try:
        decoded = unquote_to_bytes(text).decode()
    except UnicodeDecodeError:
        raise BadRequest("the address is not UTF-8") from None
    if any(ord(each) < 32 or ord(each) == 127 for each in decoded):
        raise BadRequest("the address has control characters")
    return decoded
