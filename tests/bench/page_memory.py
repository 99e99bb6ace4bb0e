"""How much memory the page's processes have while an episode is recorded and driven, minute by minute.

``python -m tests.bench.page_memory --minutes 12`` prints a table: resident memory (MB) of the page, of its operator, of
the simulation and of the recorder.
"""

import argparse
import tempfile
import time
from contextlib import closing

from rled_msgs_py.processes import Children, program

from ..web.conftest import await_that, free_port, is_open
from ..web.processes import parents, resident, words
from ..web.socket_visitor import SocketVisitor

NAMES = ("teleop_web", "web_operator", "sim_node", "record_demos")


def row(page: int) -> dict[str, float]:
    """Resident memory (MB) of the page and of what it has started, by name."""
    mine = (each for each, parent in parents().items() if page in (each, parent))
    return {name: resident(each) for each in mine for name in NAMES if any(name in word for word in words(each)[:3])}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=12.0)
    parser.add_argument("--robot", default="planar")
    parser.add_argument("--every", type=float, default=30.0, help="seconds between two rows")
    options = parser.parse_args()
    port = free_port()
    with Children() as children, tempfile.TemporaryDirectory() as folder:
        command = ["--robot", options.robot, "--port", str(port), "--output", folder]
        page = children.start([*program("rled_teleop", "teleop_web"), *command])
        await_that(lambda: children.check() or is_open(port), "the page")
        with closing(SocketVisitor(f"http://127.0.0.1:{port}")) as me:
            me.click("Begin episode")
            await_that(lambda: "<b>recording</b>" in me.text(), "the recording")
            with me.holding("To the target"):
                print("| minute |", *(f"{name} |" for name in NAMES), flush=True)
                print("|---|---|---|---|---|", flush=True)
                begun = time.monotonic()
                while (passed := time.monotonic() - begun) < 60.0 * options.minutes:
                    now = row(page.process.pid)
                    print(f"| {passed / 60:.1f} |", *(f"{now.get(name, 0):.0f} |" for name in NAMES), flush=True)
                    time.sleep(options.every)


if __name__ == "__main__":
    main()
