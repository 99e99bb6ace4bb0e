"""The page in a real browser, driving a simulated robot in a graph of its own."""

import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv
from rled_msgs_py.processes import program

SCENE = np.s_[80:, :300]
"""The part of a picture that neither the panel nor the browser's message about its missing GPU covers."""
ORANGE = (15 / 360, 50 / 360)
"""Hues of the upper arm, in whatever light."""


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def address(ros_domain: int, browser: Any, bags: Path, serve: Callable[..., Any]) -> Iterator[str]:
    with serve("--robot", "planar", "--output", str(bags), "--timeout", "1.0") as address:
        yield address


def test_page_shows_the_robot(me: Any, watcher: Any) -> None:

    def orange() -> int:
        hue, saturation, _ = np.moveaxis(rgb_to_hsv(me.shot("page")[SCENE] / 255.0), 2, 0)
        return int(((saturation > 0.35) & (hue > ORANGE[0]) & (hue < ORANGE[1])).sum())

    watcher.await_that(lambda: orange() > 300, "the orange upper arm")


def test_drag_moves_the_robot_and_release_stops_it(me: Any, watcher: Any) -> None:
    before = watcher.tool.copy()
    me.drag(0.12)
    watcher.await_that(lambda: watcher.tool[1] - before[1] > 0.03, "the robot to follow")
    me.shot("dragged")
    me.page.mouse.up()
    watcher.await_that(watcher.rests, "the robot to rest")


def test_release_stops_the_robot_within_200_ms(me: Any, watcher: Any) -> None:
    waits = []
    for name in ("y −", "y +", "y −", "y +"):
        hold = me.button(name)
        hold.hover()
        me.page.mouse.down()
        watcher.await_that(watcher.moves, f"motion by {name}")
        me.page.mouse.up()
        released = time.monotonic()
        watcher.await_that(watcher.rests, "the robot to rest")
        waits.append(watcher.last_motion(released) - released)
    print("stopped after ms:", [round(1e3 * each) for each in waits])
    assert min(waits) < 0.2


def test_motion_goes_on_while_the_pointer_is_held_still(me: Any, watcher: Any) -> None:
    me.speed(4)
    me.drag(0.25)
    watcher.await_that(watcher.moves, "motion")
    begun = watcher.tool.copy()
    watcher.await_that(lambda: np.linalg.norm(watcher.tool - begun) > 0.03, "3 cm without moving the pointer")
    me.page.mouse.up()
    watcher.await_that(watcher.rests, "the robot to rest")


def test_closing_the_tab_stops_motion(me: Any, watcher: Any) -> None:
    me.speed(4)
    me.drag(-0.3)
    watcher.await_that(watcher.moves, "motion")
    me.context.close()
    closed = time.monotonic()
    watcher.await_that(watcher.rests, "the robot to rest")
    assert watcher.last_motion(closed) - closed < 1.5


def test_a_frozen_page_stops_motion(me: Any, watcher: Any) -> None:
    me.speed(4)
    me.drag(0.3)
    watcher.await_that(watcher.moves, "motion")
    me.page.evaluate("setTimeout(() => { const end = Date.now() + 6000; while (Date.now() < end); }, 0)")
    frozen = time.monotonic()
    watcher.await_that(watcher.rests, "the robot to rest", timeout=5.0)
    assert watcher.last_motion(frozen) - frozen < 3.0
    me.page.mouse.up()


def test_second_visitor_watches_until_the_first_lets_go(me: Any, other: Any, watcher: Any) -> None:
    other.says("You watch")
    watcher.await_that(watcher.rests, "the robot to rest")
    q = watcher.q.copy()
    assert other.button("To the target").is_disabled()
    other.drag(0.2)
    other.page.mouse.up()
    assert (watcher.q == q).all()
    me.button("Let go").click()
    other.says("Nobody drives")
    other.button("Drive").click()
    other.says("You drive")
    me.says("You watch")
    other.button("y +").hover()
    other.page.mouse.down()
    watcher.await_that(watcher.moves, "motion by the second visitor")
    other.page.mouse.up()


def test_any_visitor_stops_and_the_driver_releases(me: Any, other: Any, watcher: Any) -> None:
    other.says("You watch")
    other.button("EMERGENCY STOP").click()
    me.says("emergency stop")
    me.button("y +").hover()
    me.page.mouse.down()
    time.sleep(0.5)
    me.page.mouse.up()
    assert watcher.rests(0.4)
    me.page.get_by_text("Release stop", exact=True).click()
    watcher.await_that(lambda: "emergency stop" not in me.page.locator("body").inner_text(), "release")
    me.button("y +").hover()
    me.page.mouse.down()
    watcher.await_that(watcher.moves, "motion after the release")
    me.page.mouse.up()


def test_a_slider_turns_its_joint(me: Any, watcher: Any) -> None:
    before = float(watcher.q[1])
    slider = me.page.get_by_role("slider").nth(2)  # speed, shoulder, elbow
    slider.focus()
    for _ in range(40):
        slider.press("ArrowRight")
    watcher.await_that(lambda: watcher.q[1] > before + 0.005, "the elbow to turn")


def test_recording_from_the_page_gives_a_bag_that_passes(me: Any, watcher: Any, bags: Path) -> None:
    for verdict, button in (("Keep", "y +"), ("Discard", "y −")):
        me.tab("Record")
        me.button("Begin episode").click()
        me.says("recording")
        me.tab("Drive")
        me.button(button).hover()
        me.page.mouse.down()
        watcher.await_that(watcher.moves, "motion")
        time.sleep(0.6)
        me.page.mouse.up()
        watcher.await_that(watcher.rests, "the robot to rest")
        me.tab("Record")
        me.button("End episode").click()
        me.button("Begin episode").wait_for()
        me.button(verdict).click()
        me.says("kept" if verdict == "Keep" else "discarded")
    me.button("Finish the bag").click()
    me.says("is complete")
    (bag,) = bags.iterdir()
    checked = subprocess.run([*program("rled_teleop", "demos"), "check", str(bag)], capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    me.shot("recorded")
    me.says("score")
    me.button("Replay").click()
    me.says("Stop the replay")
    me.shot("replay")
    me.button("Replay").wait_for()
