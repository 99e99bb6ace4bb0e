"""A real browser without a display, the page as a process of its own, and a node that sees the robot."""

import os
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.processes import Children, program
from rled_msgs_py.records import GateDecision
from rled_msgs_py.ros.node import fresh_context, subscribe, subscribe_ticks
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_msgs_py.topics import SAFETY_GATE, TASK_DESCRIPTION
from rled_sim.robots import ROBOTS
from rled_teleop.web.handle import SIZE as HANDLE
from rled_teleop.web.scene import FIELD_OF_VIEW, camera_for

from .socket_visitor import SocketVisitor

SHOTS = Path(__file__).parents[2] / "out" / "web_tests"
"""Where pictures of the page are kept."""
HOME = ROBOTS["planar"].home
WAIT_TIMEOUT = 60.0
SIZE = {"width": 1000, "height": 620}
GPU = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


def await_that(done: Callable[[], Any], what: str, timeout: float = WAIT_TIMEOUT) -> Any:
    """The first true answer."""
    deadline = time.monotonic() + timeout
    while not (answer := done()):
        assert time.monotonic() < deadline, f"waited {timeout:g} s for {what}"
        time.sleep(0.02)
    return answer


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    found = os.environ.get("RLED_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip("no Chromium on this machine (apt-get install chromium, or name one in RLED_CHROMIUM)")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as chromium:
        launched = chromium.chromium.launch(executable_path=found, args=GPU)
        yield launched
        launched.close()


def take_the_wheel(visitor: SocketVisitor) -> None:
    """Drive; who drove before may leave only after this one has come, which then has to ask."""
    await_that(lambda: "You drive" in visitor.text() or "Nobody drives" in visitor.text(), "a free wheel")
    if "Nobody drives" in visitor.text():
        visitor.click("Drive")
        await_that(lambda: "You drive" in visitor.text(), "the wheel")


class Watcher:
    """Sees each tick, with the time at which it came, and each decision, in a thread of its own."""

    def __init__(self) -> None:
        self._context = fresh_context()
        self._node = Node("watcher", context=self._context)
        self.ticks: list[tuple[float, Tick]] = []
        self.task: list[Any] = []
        subscribe_ticks(self._node, lambda tick: self.ticks.append((time.monotonic(), tick)), 1000)
        subscribe(self._node, TASK_DESCRIPTION, self.task.append)
        self.decisions: list[GateDecision] = []
        subscribe(self._node, SAFETY_GATE, self.decisions.append)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin)
        self._thread.start()

    @property
    def q(self) -> np.ndarray:
        return self.ticks[-1][1].joints.position

    @property
    def tool(self) -> np.ndarray:
        return self.ticks[-1][1].ee.position

    def last_motion(self, since: float) -> float:
        """When the joints last changed after a moment; the moment itself if they did not."""
        pairs = [(when, tick) for when, tick in self.ticks if when > since - 1.0]
        q = [tick.joints.position for _, tick in pairs]
        moved = [pairs[k + 1][0] for k in range(len(pairs) - 1) if (q[k] != q[k + 1]).any()]
        return max([since, *moved])

    def await_that(self, done: Callable[[], Any], what: str, timeout: float = WAIT_TIMEOUT) -> Any:
        return await_that(done, what, timeout)

    def rests(self, seconds: float = 0.5) -> bool:
        """Whether the joints have stood still for so long."""
        now = time.monotonic()
        return now - self.last_motion(now - 2 * seconds - 1.0) > seconds

    def is_home(self) -> bool:
        return self.rests(0.1) and self.ticks[-1][1].status.episode > 0 and np.allclose(self.q, HOME, atol=1e-6)

    def moves(self) -> bool:
        now = time.monotonic()
        return self.last_motion(now - 0.3) > now - 0.3

    def close(self) -> None:
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture(scope="module")
def watcher(ros_domain: int) -> Iterator[Watcher]:
    watcher = Watcher()
    yield watcher
    watcher.close()


def free_port() -> int:
    with closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def serving(*options: str) -> Iterator[str]:
    """``teleop_web`` with some options; gives its address."""
    port = free_port()
    with Children() as children:
        children.start([*program("rled_teleop", "teleop_web"), "--port", str(port), *options])
        address = f"http://127.0.0.1:{port}"
        await_that(lambda: children.check() or is_open(port), "the page")
        yield address


def is_open(port: int) -> bool:
    with closing(socket.socket()) as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


class Visit:
    """One open page."""

    def __init__(self, browser: Any, address: str, watcher: Watcher) -> None:
        # half the resolution: without a GPU, drawing takes the processors that the robot needs
        self.context = browser.new_context(viewport=SIZE, device_scale_factor=0.5)
        self.context.set_default_timeout(1e3 * WAIT_TIMEOUT)
        self.page = self.context.new_page()
        self._watcher = watcher
        self.page.goto(address)
        self.says("You drive", "You watch", "Nobody drives")
        await_that(lambda: watcher.ticks and watcher.task, "a tick")

    def says(self, *any_of: str) -> str:
        body = self.page.locator("body")
        return str(await_that(lambda: next((each for each in any_of if each in body.inner_text()), None), str(any_of)))

    def button(self, name: str) -> Any:
        return self.page.get_by_role("button", name=name, exact=True)

    def shot(self, name: str) -> np.ndarray:
        """A screenshot as an array, shape (height, width, 3); it is kept, too."""
        SHOTS.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=SHOTS / f"{name}.png")
        return np.round(imread(SHOTS / f"{name}.png")[..., :3] * 255).astype(int)

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name).click()

    def speed(self, percent: int) -> None:
        box = self.page.get_by_role("textbox").first
        box.fill(str(percent))
        box.press("Enter")

    def place(self, point: np.ndarray) -> tuple[float, float]:
        """Where a point (m) is on the page (pixels), by a pinhole camera."""
        camera = camera_for(TaskDescription.from_json(self._watcher.task[-1].data))
        box = self.page.locator("canvas").first.bounding_box()
        eye, at = np.array(camera.position), np.array(camera.look_at)
        forward = (at - eye) / np.linalg.norm(at - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        offset = point - eye
        scale = box["height"] / 2 / np.tan(FIELD_OF_VIEW / 2) / (offset @ forward)
        return box["x"] + box["width"] / 2 + offset @ right * scale, box["y"] + box["height"] / 2 - offset @ up * scale

    def _beside_tool(self, along_y: float) -> np.ndarray:
        return self._watcher.tool + np.array([0.0, along_y, 0.0])

    def grab(self) -> tuple[float, float]:
        """Press the pointer on the handle's arrow along y."""
        place = self.place(self._beside_tool(0.6 * HANDLE))
        self.page.mouse.move(*place)
        self.page.mouse.down()
        return place

    def drag(self, metres: float) -> None:
        """Grab the arrow along y and pull; the pointer stays pressed."""
        x, y = self.grab()
        goal = self.place(self._beside_tool(0.6 * HANDLE + metres))
        for share in np.linspace(0.0, 1.0, 8)[1:]:
            self.page.mouse.move(x + share * (goal[0] - x), y + share * (goal[1] - y))


class Visits:
    """The pages that a test file has open: one that drives, for as long as it lives, and others."""

    def __init__(self, browser: Any, address: str, watcher: Watcher) -> None:
        self._make = lambda: Visit(browser, address, watcher)
        self._watcher = watcher
        self._driver: Visit | None = None
        self._others: list[Visit] = []

    def driver(self) -> Visit:
        if self._driver is None or self._driver.page.is_closed():
            self._driver = self._make()
        if self._driver.says("You drive", "You watch", "Nobody drives") != "You drive":
            self._driver.button("Drive").click()
            self._driver.says("You drive")
        self._driver.tab("Drive")
        self._driver.speed(50)
        self._driver.page.get_by_text("New episode", exact=True).click()
        self._watcher.await_that(self._watcher.is_home, "the robot at home")
        return self._driver

    def another(self) -> Visit:
        self._others.append(self._make())
        return self._others[-1]

    def close_others(self) -> None:
        for each in self._others:
            each.context.close()
        self._others.clear()


@pytest.fixture(scope="module")
def visits(browser: Any, address: str, watcher: Watcher) -> Visits:
    """Opens pages at the test file's own ``address``."""
    return Visits(browser, address, watcher)


@pytest.fixture
def me(visits: Visits) -> Iterator[Visit]:
    """The page that drives."""
    driver = visits.driver()
    yield driver
    if not driver.page.is_closed():
        driver.page.mouse.up()


@pytest.fixture
def other(visits: Visits, me: Visit) -> Iterator[Visit]:
    """A second visitor."""
    yield visits.another()
    visits.close_others()


@pytest.fixture(scope="session")
def serve() -> Callable[..., Any]:
    return serving
