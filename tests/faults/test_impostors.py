"""Strangers: with the names of our nodes and services that answer nonsense, or with large messages; the nodes go on."""

import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_agent.nodes.restart import Restart
from rled_msgs_py.errors import RledError
from rled_msgs_py.processes import Child, Children, program
from rled_msgs_py.ros.node import fresh_context, spin_until

from ..graph.conftest import Observer
from ..graph.team import actor_like
from ..web.conftest import await_that, free_port, is_open, take_the_wheel
from ..web.socket_visitor import SocketVisitor
from .impostor import SERVICES, answers_of
from .memory import measure

IMPOSTOR = [sys.executable, str(Path(__file__).with_name("impostor.py"))]
WAIT_TIMEOUT = 60.0
ENDLESS = ("--robot", "planar", "--mode", "real_time", "--targets-per-episode", "0", "--max-steps", "0")
SWITCHES = {"sim": ("Pause", "Run", "New episode", "Release stop")}
ASKED = ("Begin episode", "End episode", "Keep", "Discard", "Mark pose", "Learn", "Stop learning", "Save checkpoint")


@contextmanager
def impostors(*names: str) -> Iterator[Child]:
    """They are there."""
    with Children() as children:
        child = children.start([*IMPOSTOR, *names], echo=False)
        await_that(lambda: "there" in child.last_lines, "the impostors")
        yield child


def test_the_page_lives_among_impostors_and_drives() -> None:
    port = free_port()
    with Children() as children:
        children.start([*program("rled_sim", "sim_node"), "--discovery-wait", "0.2", *ENDLESS], echo=False)
        options = ["--port", str(port), "--role", "alone"]
        page = children.start([*program("rled_teleop", "teleop_web"), *options], echo=False)
        await_that(lambda: is_open(port), "the page")
        visitor = SocketVisitor(f"http://127.0.0.1:{port}")
        take_the_wheel(visitor)
        with impostors(*SERVICES) as strangers:
            heard: set[str] = set()

            def all_said() -> bool:
                """They have given all their answers to what the page asks by itself, and to what is pressed."""
                assert page.exit_code is None, list(page.last_lines)
                for label in ASKED:
                    visitor.click(label)
                for label in SWITCHES["sim"]:
                    visitor.press("Simulation", label)
                visitor.enter("ξ threshold", 0.5)
                heard.update(strangers.last_lines)
                time.sleep(0.1)  # as a person
                return heard >= {f"all of {name}" for name in ("list_parameters", "get_parameters", "reset", "record")}

            await_that(all_said, "all answers", 2 * WAIT_TIMEOUT)
            with closing(Observer()) as observer:
                before = observer.wait_ticks(1)[-1].ee.position[1]
                visitor.press("Simulation", "Release stop")
                visitor.press("Simulation", "Run")
                with visitor.holding("y +"):
                    observer.wait(lambda: observer.ticks[-1].ee.position[1] > before + 0.01, "motion")
        assert page.exit_code is None
        assert "x" * 1000 not in visitor.text()
        said = "\n".join(page.last_lines)
        assert "Traceback" not in said
        assert max(map(len, page.last_lines)) < 2000
        visitor.close()


def test_a_restart_is_an_error_whatever_the_simulation_answers(ros_domain: int) -> None:
    context = fresh_context()
    node, executor = Node("asking", context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    restart = Restart(node, lambda done, what: spin_until(executor, done, 8.0, what))
    outcomes: Counter[str] = Counter()
    with impostors("sim"):
        for seed in [None] * len(answers_of(SERVICES["sim"]["reset"])) + [1] * 6:
            with pytest.raises(RledError) as error:
                restart.begin(seed)
            assert len(str(error.value)) < 3000
            outcomes[str(error.value).split()[0]] += 1
    assert outcomes.total() == sum(outcomes.values())
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def test_watching_a_simulation_that_lies_ends_with_one_line(ros_domain: int) -> None:
    with impostors("sim"):
        command = [*program("rled_agent", "watch_episodes"), "--seed", "1"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_TIMEOUT, check=False)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith("error: 0 answers of ")


# What a stranger sends in large messages is paid for as long as they last, not longer.


SECONDS = 5.0


def test_memory_comes_back_after_large_messages(planar_expert: Path, tmp_path: Path) -> None:
    """Nodes have grown by a tenth at most; before, each kept several times what it needs."""
    actor = actor_like(planar_expert, tmp_path / "actor.safetensors")
    figures = measure(SECONDS, tmp_path, planar_expert, actor)
    kept = {name: round(after / before - 1.0, 2) for name, (before, _, after) in figures.items()}
    assert max(kept.values()) < 0.2, figures
