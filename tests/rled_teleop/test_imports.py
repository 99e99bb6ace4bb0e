"""Imports point one way: nodes and commands use the page, the recording and the operators, and none of these ROS."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import rled_teleop

PACKAGE = Path(rled_teleop.__file__).parent
ALLOWED = {
    "recording": {"recording"},
    "operators": {"operators"},
    "web": {"web", "operators"},
    "cli": {"cli", "recording"},
    "nodes": {"nodes", "web", "recording", "operators"},
}
"""What each folder may import of this package, besides modules that lie in no folder."""
ROS = ("rclpy", "std_srvs", "sensor_msgs", "rcl_interfaces", "visualization_msgs")


def imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def test_folders_import_each_other_one_way() -> None:
    for path in PACKAGE.rglob("*.py"):
        folder = path.relative_to(PACKAGE).parts[0]
        own = {name.split(".")[1] for name in imported(path) if name.startswith("rled_teleop.")}
        assert own & ALLOWED.keys() <= ALLOWED.get(folder, set()), path


def test_all_but_the_nodes_import_without_ros() -> None:
    paths = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if "nodes" not in path.parts]
    names = [".".join(["rled_teleop", *path.with_suffix("").parts]) for path in paths]
    program = f"import sys; sys.modules |= dict.fromkeys({ROS!r})\n" + "\n".join(f"import {name}" for name in names)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
