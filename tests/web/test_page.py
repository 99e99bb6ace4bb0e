"""The page in a real browser, driving a simulated robot in a graph of its own."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ORANGE = (237, 140, 35)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bags")


@pytest.fixture(scope="module")
def address(ros_domain: int, browser: Any, bags: Path, serve: Callable[..., Any]) -> Iterator[str]:
    with serve("--robot", "planar", "--output", str(bags), "--timeout", "1.0") as address:
        yield address


def test_page_shows_the_robot(visit: Any, watcher: Any) -> None:
    me = visit()
    me.says("You drive")

    def orange() -> int:
        picture = me.shot("page")
        hue = picture / np.maximum(picture.max(axis=2, keepdims=True), 1)
        return int((np.abs(hue - np.array(ORANGE) / 237.0).max(axis=2) < 0.12).sum())

    watcher.await_that(lambda: orange() > 300, "the orange upper arm")


def test_drag_moves_the_robot_and_release_stops_it(visit: Any, watcher: Any) -> None:
    me = visit()
    me.says("You drive")
    before = watcher.tool.copy()
    me.drag(0.12)
    watcher.await_that(lambda: watcher.tool[1] - before[1] > 0.03, "the robot to follow")
    me.shot("dragged")
    me.page.mouse.up()
    watcher.await_that(watcher.rests, "the robot to rest")
