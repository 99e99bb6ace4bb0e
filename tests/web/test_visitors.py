"""Visitors who speak the page's protocol themselves: honest ones, ones that lie, ones that fall silent."""

import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rled_msgs_py.processes import program

from .conftest import take_the_wheel
from .socket_visitor import SocketVisitor


@pytest.fixture(scope="module", params=["real_time", "lockstep"])
def mode(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory, mode: str) -> Path:
    return tmp_path_factory.mktemp(f"bags_{mode}")


@pytest.fixture(scope="module")
def address(watcher: Any, serve: Callable[..., Any], mode: str, bags: Path) -> Iterator[str]:
    before = len(watcher.ticks)
    with serve("--robot", "planar", "--sim-options", f"--mode {mode}", "--output", str(bags)) as address:
        watcher.await_that(lambda: len(watcher.ticks) > before, "this simulation's first tick")
        yield address


@pytest.fixture
def visitor(address: str, watcher: Any) -> Iterator[Callable[[], SocketVisitor]]:
    opened: list[SocketVisitor] = []

    def come() -> SocketVisitor:
        me = SocketVisitor(address)
        opened.append(me)
        me.find("y +")
        if len(opened) == 1:
            take_the_wheel(me)
        return me

    yield come
    for each in opened:
        each.close()
    watcher.await_that(watcher.rests, "the robot to rest")


def test_a_held_button_moves_the_robot_and_letting_go_stops_it_within_200_ms(visitor: Any, watcher: Any) -> None:
    me, waits = visitor(), []
    for label in ("y −", "y +", "y −"):
        before = watcher.tool[1]
        with me.holding(label):
            watcher.await_that(lambda before=before: abs(watcher.tool[1] - before) > 0.01, label)
        released = time.monotonic()
        watcher.await_that(watcher.rests, "the robot to rest")
        waits.append(watcher.last_motion(released) - released)
        assert (watcher.tool[1] > before) == (label == "y +")
    print("stopped after ms:", [round(1e3 * each) for each in waits])
    assert min(waits) < 0.2


def test_a_connection_that_ends_stops_motion(visitor: Any, watcher: Any) -> None:
    me = visitor()
    with me.holding("y −"):
        watcher.await_that(watcher.moves, "motion")
    me.close()
    closed = time.monotonic()
    watcher.await_that(watcher.rests, "the robot to rest")
    assert watcher.last_motion(closed) - closed < 1.0


def test_a_watcher_that_forges_messages_moves_nothing(visitor: Any, watcher: Any) -> None:
    driver, liar = visitor(), visitor()
    watcher.await_that(lambda: driver.is_disabled("y +") is False, "the driver's buttons")
    assert liar.is_disabled("y +")
    q = watcher.q.copy()
    for _ in range(10):
        liar.hold_once("y +")
        liar.hold_once("To the target")
        liar.click("Begin episode")
        time.sleep(0.02)
    time.sleep(0.5)
    assert np.array_equal(watcher.q, q)


def test_the_driver_drags_the_target_and_a_watcher_does_not(visitor: Any, watcher: Any, mode: str) -> None:
    driver, liar = visitor(), visitor()
    driver.enter("Arrows at the target too", True)
    before = watcher.ticks[-1][1].target.position.copy()
    liar.drag(0.5, 0.3, 0.1, handle="/target_handle")
    driver.drag(0.5, -0.3, 0.1, handle="/target_handle")
    if mode == "lockstep":
        watcher.await_that(lambda: "commands refused" in driver.text(), "the refusal")
        assert np.array_equal(watcher.ticks[-1][1].target.position, before)
    else:
        watcher.await_that(lambda: watcher.ticks[-1][1].target.position[1] != before[1], "the target to move")
        assert watcher.ticks[-1][1].target.position == pytest.approx([0.5, -0.3, before[2]])


def test_a_second_visitor_drives_when_the_first_has_gone(visitor: Any, watcher: Any) -> None:
    first, second = visitor(), visitor()
    second.click("Drive")
    time.sleep(0.5)
    assert second.is_disabled("y +")
    first.close()
    watcher.await_that(lambda: "Nobody drives" in second.text(), "the wheel to be free")
    second.click("Drive")
    watcher.await_that(lambda: "You drive" in second.text(), "the wheel")
    with second.holding("y −"):
        watcher.await_that(watcher.moves, "motion")


def test_only_what_can_be_used_looks_so(visitor: Any, watcher: Any) -> None:
    driver, other = visitor(), visitor()
    watcher.await_that(lambda: "Simulation" in driver.labels() and "Simulation" not in other.labels(), "the switches")
    watcher.await_that(lambda: other.is_disabled("y +") and not driver.is_disabled("y +"), "the buttons")
    assert driver.is_disabled("Replay")
    assert "gray" not in driver.colours()


def test_any_visitor_stops_and_only_the_driver_releases(visitor: Any, watcher: Any, mode: str) -> None:
    driver, other = visitor(), visitor()
    other.click("EMERGENCY STOP")
    watcher.await_that(lambda: "emergency stop" in driver.text(), "the stop")
    q = watcher.q.copy()
    with driver.holding("y +"):
        time.sleep(0.6)
    assert np.array_equal(watcher.q, q)
    driver.press("Simulation", "Release stop")
    watcher.await_that(lambda: "emergency stop" not in driver.text(), "the release")
    with driver.holding("y +"):
        watcher.await_that(watcher.moves, "motion")


def test_a_silent_driver_can_be_relieved(visitor: Any, watcher: Any) -> None:
    silent, other = visitor(), visitor()
    silent.alive = False
    watcher.await_that(lambda: other.may_drive(), "the wheel to be free", timeout=30.0)
    other.click("Drive")
    watcher.await_that(lambda: "You drive" in other.text(), "the wheel")
    assert "You watch" in silent.text() or watcher.await_that(lambda: "You watch" in silent.text(), "the news")


def test_what_a_control_does_not_offer_springs_back(visitor: Any, watcher: Any, bags: Path) -> None:
    me = visitor()
    for label, values in {
        "Bag": ["/etc", str(bags), "..", str(bags / "nothing"), 7, True, ""],
        "Episode": ["99", "-1", "x"],
        "Simulation": ["estop", "token", 1],
        "Speed %": [0, 101, -5.0, 1e308, "50", "fast", True],
    }.items():
        before = me.value(label)
        for value in values:
            springs = me.received["GuiUpdateMessage"]
            me.enter(label, value)
            watcher.await_that(lambda springs=springs: me.received["GuiUpdateMessage"] > springs, f"{label} again")
            watcher.await_that(lambda label=label, before=before: me.value(label) == before, f"{label} as it was")
    assert str(bags) not in me.text()
    assert "/etc" not in me.text()


def test_two_recorded_episodes_make_a_bag_that_passes_and_replays(visitor: Any, watcher: Any, bags: Path) -> None:
    me = visitor()
    for label, verdict, word in (("y −", "Keep", "kept"), ("y +", "Discard", "discarded")):
        me.click("Begin episode")
        watcher.await_that(lambda: "<b>recording</b>" in me.text(), "the recorder")
        with me.holding(label):
            watcher.await_that(watcher.moves, "motion")
            time.sleep(0.5)
        watcher.await_that(watcher.rests, "the robot to rest")
        me.click("End episode")
        watcher.await_that(lambda: "<b>recording</b>" not in me.text(), "the end of the episode")
        me.click(verdict)
        watcher.await_that(lambda word=word: word in me.text(), word)
    me.click("Finish the bag")
    watcher.await_that(lambda: "is complete" in me.text() and "| score |" in me.text(), "the bag")
    (bag,) = bags.iterdir()
    checked = subprocess.run([*program("rled_teleop", "demos"), "check", str(bag)], capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    meshes = me.received["MeshMessage"]
    me.click("Replay")
    watcher.await_that(lambda: me.received["MeshMessage"] > meshes, "the ghost")
    me.find("Replay")
