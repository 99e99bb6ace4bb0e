"""Requests as they come over the network: read, or refused as malformed, whatever they are."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_teleop.web.request import BadRequest, read_request
from websockets.datastructures import Headers

HERE = ("Host", "localhost:8080")
BYTES = st.binary(max_size=40).map(lambda data: data.decode("ascii", "surrogateescape"))
"""What the server makes of any bytes."""
NAMES = st.sampled_from(["Host", "Origin", "Cookie", "Upgrade", "Accept-Encoding", "Sec-WebSocket-Protocol", "X"])


def headers(*pairs: tuple[str, str]) -> Headers:
    """As the server reads them."""
    made = Headers()
    for pair in pairs:
        made.set_insecure(*pair)
    return made


@given(target=BYTES.map(lambda text: "/" + text), pairs=st.lists(st.tuples(NAMES, BYTES), max_size=6))
def test_any_request_is_read_or_malformed(target: str, pairs: list[tuple[str, str]]) -> None:
    try:
        request = read_request(target, headers(HERE, *pairs))
    except BadRequest:
        return
    for text in (request.path, *request.tokens, *request.cookies, *request.protocols):
        assert text.encode()
    assert request.name == "localhost"


def test_name_of_the_host_is_found() -> None:
    for host, name in [
        ("localhost", "localhost"),
        ("LocalHost:1", "localhost"),
        ("127.0.0.1:65535", "127.0.0.1"),
        ("[::1]", "::1"),
        ("[0:0::1]:8080", "::1"),
        ("[::ffff:127.0.0.1]", "::ffff:7f00:1"),
    ]:
        assert read_request("/", headers(("Host", host))).name == name


def test_malformed_host_is_refused() -> None:
    for host in (
        "", " ", "a b", "a@localhost", "localhost:", "localhost:x", "localhost:65536", "localhost:8080:1", "[::1",
        "::1", "[::1]x", "[localhost]", "[1:2]", "[::1%25lo]", "h\udcc3\udcb6", "localhost/", "a,b",
    ):  # fmt: skip
        with pytest.raises(BadRequest, match="Host"):
            read_request("/", headers(("Host", host)))


def test_host_has_to_be_there_once() -> None:
    for pairs in ([], [HERE, HERE]):
        with pytest.raises(BadRequest, match="Host"):
            read_request("/", headers(*pairs))


def test_malformed_origin_is_refused() -> None:
    for origin in [
        "",
        "localhost",
        "http:localhost",
        "http://[::1",
        "http://a b",
        "http://\udcff",
        "http://a/b",
        "http://u@a",
    ]:
        with pytest.raises(BadRequest, match="Origin"):
            read_request("/", headers(HERE, ("Origin", origin)))


def test_malformed_address_is_refused() -> None:
    for target, status in [
        ("", 400),
        ("*", 400),
        ("http://localhost/", 400),
        ("/%", 400),
        ("/%4", 400),
        ("/%zz", 400),
        ("/%00", 400),
        ("/%0d%0a", 400),
        ("/%ff", 400),
        ("/\udcff", 400),
        ("/?token=%", 400),
        ("/?%ff=1", 400),
        ("/" + "a" * 256, 414),
    ]:
        with pytest.raises(BadRequest) as refused:
            read_request(target, headers(HERE))
        assert refused.value.status == status


def test_parts_are_decoded() -> None:
    pairs = ("Cookie", "a=b; c=d"), ("Cookie", "e=f"), ("Upgrade", "h2c, WebSocket"), ("Accept-Encoding", "gzip")
    request = read_request("/a%20b%C3%A9?x=1&token=a+b%2Bc&token=&y", headers(HERE, *pairs, ("Origin", "HTTP://A:1")))
    assert request.path == "/a bé"
    assert request.tokens == ("a b+c", "")
    assert request.cookies == ("a=b", "c=d", "e=f")
    assert (request.is_socket, request.origin, request.encodings) == (True, "a:1", "gzip")


def test_other_characters_than_ascii_are_refused() -> None:
    for name in ["Cookie", "Upgrade", "Accept-Encoding", "Sec-WebSocket-Protocol"]:
        with pytest.raises(BadRequest, match=name):
            read_request("/", headers(HERE, (name, "a=\udcff")))
