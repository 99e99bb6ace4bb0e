"""Who gets the page: the word that opens it, where it may come from and who sees it; names and origins."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rled_msgs_py.errors import RledError
from rled_teleop.nodes.teleop_web import address, without_token
from rled_teleop.web.access import Access, access_for
from rled_teleop.web.connection import RateLimiter
from rled_teleop.web.params import WebParams
from rled_teleop.web.request import read_request
from rled_teleop.web.token import given_token
from websockets.datastructures import Headers

from .processes import one_with, words
from .test_protection import get

WORD = "correct horse battery"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "the token"
    path.write_text(f"{WORD}\n")
    path.chmod(0o600)
    return path


def test_token_comes_from_option_file_or_environment(file: Path) -> None:
    assert given_token(WebParams(), {}).word == ""
    assert given_token(WebParams(token=WORD), {"RLED_TOKEN": "another"}).word == WORD
    assert given_token(WebParams(token_file=str(file)), {}).word == WORD
    assert given_token(WebParams(), {"RLED_TOKEN": WORD}).word == WORD


def test_token_is_taken_out_of_the_environment_that_children_inherit() -> None:
    environment = {"RLED_TOKEN": WORD, "HOME": "/"}
    given_token(WebParams(), environment)
    assert environment == {"HOME": "/"}


def test_only_what_everybody_sees_is_printed(file: Path) -> None:
    printed = address(WebParams(token=WORD), given_token(WebParams(token=WORD), {}))
    assert printed == "http://127.0.0.1:8080/?token=correct%20horse%20battery"
    for params, environment in ((WebParams(token_file=str(file)), {}), (WebParams(), {"RLED_TOKEN": WORD})):
        printed = address(params, given_token(params, environment))
        assert printed.startswith("http://127.0.0.1:8080/?token=WORD (WORD: ")
        assert WORD not in printed
    assert address(WebParams(), given_token(WebParams(), {})) == "http://127.0.0.1:8080/"


def test_a_file_that_all_users_can_read_is_warned_of(file: Path) -> None:
    assert given_token(WebParams(token_file=str(file)), {}).warning == ""
    file.chmod(0o644)
    warning = given_token(WebParams(token_file=str(file)), {}).warning
    subprocess.run(warning.rpartition(": ")[2], shell=True, check=True)
    assert given_token(WebParams(token_file=str(file)), {}).warning == ""


@pytest.mark.parametrize(
    "content",
    [None, b"", b" \n", b"two\nlines of words", b"\xff" * 20, b"a" * 5000, b"tab\there and there", b"nul\0 and more"],
    ids=["missing", "empty", "blank", "lines", "not utf-8", "too long", "tab", "nul"],
)
def test_a_file_without_a_word_is_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "token"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RledError):
        given_token(WebParams(token_file=str(path)), {})


def test_the_remedy_makes_a_file_that_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "no folder" / "a robot's token"
    with pytest.raises(RledError) as refused:
        given_token(WebParams(token_file=str(path)), {})
    subprocess.run(str(refused.value).rpartition("; ")[2], shell=True, check=True)
    made = given_token(WebParams(token_file=str(path)), {})
    assert (len(made.word), made.warning) == (32, "")


def test_a_folder_and_two_places_are_refused(tmp_path: Path, file: Path) -> None:
    for params in (WebParams(token_file=str(tmp_path)), WebParams(token=WORD, token_file=str(file))):
        with pytest.raises(RledError):
            given_token(params, {})


def test_children_are_not_given_the_token() -> None:
    for given, left in [
        (["-p", "token:=secret", "-r", "__ns:=/left"], ["-r", "__ns:=/left"]),
        (["--param", "teleop_web:token:=secret"], []),
        (["-r", "token:=other"], ["-r", "token:=other"]),
        (["-p", "use_sim_time:=true"], ["-p", "use_sim_time:=true"]),
    ]:
        assert without_token(given) == left


def test_no_process_shows_the_token_of_a_file(ros_domain: int, file: Path, serve: Callable[..., Any]) -> None:
    with serve("--robot", "planar", "--token-file", str(file)) as page:
        assert get(page).status == 403
        assert get(page, "/?token=correct+horse+battery").status == 303
        started = {name: one_with(f"/{name}") for name in ("sim_node", "web_operator")}
        for process in (*started.values(), one_with("teleop_web")):
            assert not any("horse" in word for word in words(process))
        for process in started.values():
            assert not any("horse" in word for word in words(process, "environ"))


# Who gets the page: judged by name, origin and token, without a server.


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
