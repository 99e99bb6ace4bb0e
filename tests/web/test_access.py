"""Who gets the page: judged by name, origin and token, without a server."""

import pytest
from rled_msgs_py.errors import RledError
from rled_teleop.web.access import Access, access_for
from rled_teleop.web.connection import RateLimiter
from rled_teleop.web.request import read_request
from websockets.datastructures import Headers

TOKEN = "correct horse battery"
HERE = Headers(Host="localhost:8080")


def ask(access: Access, target: str = "/", **headers: str) -> bool:
    return access.verdict(read_request(target, Headers({"Host": "localhost:8080"} | headers))).allowed


def test_page_called_by_a_name_of_this_machine_is_served() -> None:
    for host in ["localhost:8080", "127.0.0.1:8080", "127.0.0.2", "[::1]:8080", "localhost"]:
        assert ask(Access(), Host=host)


def test_page_called_by_another_name_is_refused() -> None:
    for host in ["evil.example:8080", "localhost.evil.example", "10.0.0.1:8080", "[2001:db8::1]", "127.0.0.1.x"]:
        assert not ask(Access(), Host=host)


def test_websocket_of_another_site_is_refused() -> None:
    for origin in ["http://evil.example", "http://localhost:9999", "null", "https://localhost"]:
        for token in ["", TOKEN]:
            cookie = Access(TOKEN).verdict(read_request("/?token=correct%20horse%20battery", HERE)).cookie
            assert not ask(Access(token), Upgrade="websocket", Origin=origin, Cookie=cookie)
            assert not ask(Access(token), Upgrade="WebSocket", Origin=origin, Cookie=cookie)


def test_websocket_of_the_page_itself_is_served() -> None:
    assert ask(Access(), Upgrade="websocket", Origin="http://localhost:8080")


def test_without_the_right_token_nothing_is_served() -> None:
    for target in ["/", "/?token=", "/?token=wrong", "/?token=correct", "/?token=correct+horse+batteryx"]:
        assert not ask(Access(TOKEN), target)
        assert not ask(Access(TOKEN), target, Upgrade="websocket", Origin="http://localhost:8080")
        assert not ask(Access(TOKEN), target, Cookie="rled_teleop_web=0; other=1")


def test_right_token_gives_a_cookie_that_opens_the_page() -> None:
    verdict = Access(TOKEN).verdict(read_request("/?token=correct+horse%20battery", Headers(Host="robot.example")))
    assert verdict.allowed
    assert TOKEN not in verdict.cookie
    assert ask(Access(TOKEN), Host="robot.example", Cookie=f"a=b; {verdict.cookie}")
    assert not ask(Access(TOKEN + "!"), Cookie=verdict.cookie)


def test_other_machines_need_a_token() -> None:
    for host in ["0.0.0.0", "::", "192.168.1.5", "robot.example"]:
        with pytest.raises(RledError, match="--token-file"):
            access_for(host, "")
        assert access_for(host, TOKEN) == Access(TOKEN)


def test_short_token_is_refused() -> None:
    with pytest.raises(RledError, match="12 or more"):
        access_for("0.0.0.0", "password")


def test_messages_are_read_at_once_until_the_burst_is_spent_then_at_the_rate() -> None:
    allowance = RateLimiter(rate=10.0, burst=3.0)
    assert [allowance.wait(100.0) for _ in range(3)] == [0.0, 0.0, 0.0]
    assert allowance.wait(100.0) == pytest.approx(0.1)
    assert allowance.wait(100.1) == pytest.approx(0.1)
    assert allowance.wait(200.0) == 0.0
