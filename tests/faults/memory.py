"""How much memory the nodes keep of a stranger's large messages: ``python -m tests.faults.memory [SECONDS]``."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from rled_msgs_py.processes import Child, Children, program

from ..conftest import free_domain
from ..graph.team import DEMONSTRATION, actor_like, expert_of
from ..web.conftest import free_port

FLOOD = [sys.executable, str(Path(__file__).with_name("flood.py"))]
SETTLES = 30.0
"""Seconds that memory is given to come back."""
QUIET = 12
"""Looks, half a second apart, in which no node grows before it is measured."""
SHARE = 0.2
"""Of a node's memory that may come on top."""
ENDLESS = ("--robot", "planar", "--mode", "real_time", "--targets-per-episode", "0", "--max-steps", "0")


def resident(child: Child) -> float:
    """Memory of a process (MB)."""
    pages = int(Path(f"/proc/{child.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@contextmanager
def nodes(folder: Path, expert: Path, actor: Path) -> Iterator[Mapping[str, Child]]:
    """All that listen, at work."""
    commands = {
        "sim_node": [*program("rled_sim", "sim_node"), "--discovery-wait", "0.2", *ENDLESS],
        "agent_node": [*program("rled_agent", "agent_node"), "--expert", str(expert), "--agent", str(actor)],
        "record_demos": [*program("rled_teleop", "record_demos"), "--output", str(folder / "bag")],
        "watch_episodes": [*program("rled_agent", "watch_episodes"), "--output", str(folder / "watched")],
        "teleop_web": [*program("rled_teleop", "teleop_web"), "--port", str(free_port())],
        "teleop_kinesthetic": [*program("rled_teleop", "teleop_kinesthetic"), "--beside-agent"],
    }
    with Children() as children:
        yield {name: children.start(command, echo=False) for name, command in commands.items()}


def settled(running: Mapping[str, Child], enough: Callable[[Mapping[str, float]], bool]) -> dict[str, float]:
    """Memory of the nodes (MB) when it is enough, or when they have had the time to settle."""
    deadline = time.monotonic() + SETTLES
    while not enough(found := {name: resident(child) for name, child in running.items()}):
        if time.monotonic() > deadline:
            break
        time.sleep(0.5)
    return found


def measure(seconds: float, folder: Path, expert: Path, actor: Path) -> dict[str, tuple[float, float, float]]:
    """Memory of each node (MB): before a flood of so many seconds, at its end, and when it has settled."""
    with nodes(folder, expert, actor) as running:
        newest: list[Mapping[str, float]] = [dict.fromkeys(running, 0.0)] * QUIET

        def rests(found: Mapping[str, float]) -> bool:
            newest.append(found)
            return all(found[name] < newest[-QUIET][name] + 0.5 for name in running)

        before = settled(running, rests)
        print(subprocess.run([*FLOOD, str(seconds)], capture_output=True, text=True, check=True).stdout.strip())
        during = {name: resident(child) for name, child in running.items()}
        after = settled(running, lambda found: all(found[name] < (1.0 + SHARE / 2) * before[name] for name in running))
        for child in running.values():
            assert child.exit_code is None, list(child.last_lines)
    return {name: (before[name], during[name], after[name]) for name in running}


def main() -> None:
    """Print a table."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    with TemporaryDirectory() as name, free_domain() as domain:
        os.environ |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        folder = Path(name)
        expert = expert_of(DEMONSTRATION, folder)
        figures = measure(seconds, folder, expert, actor_like(expert, folder / "actor.safetensors"))
        size = sum(each.stat().st_size for each in (folder / "bag").iterdir()) / 1e6
    for node, (before, during, after) in figures.items():
        print(f"{node:20} {before:7.0f} MB, {during:7.0f} MB at the end of the flood, {after:7.0f} MB after")
    print(f"the bag: {size:.1f} MB")


if __name__ == "__main__":
    main()
