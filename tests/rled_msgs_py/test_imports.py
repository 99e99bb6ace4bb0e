"""The contract is read without ROS and without a simulator."""

import ast
import subprocess
import sys
from pathlib import Path

import rled_msgs_py

from .samples import write_bag

BLOCKED = (
    "rclpy", "pybullet", "std_msgs", "sensor_msgs", "geometry_msgs", "diagnostic_msgs", "builtin_interfaces",
    "rcl_interfaces", "rosgraph_msgs", "visualization_msgs", "torch",
)  # fmt: skip
PACKAGE = Path(rled_msgs_py.__file__).parent
NOTHING_BUT_ROS = PACKAGE / "ros"


def modules_without_ros():
    for path in sorted(PACKAGE.rglob("*.py")):
        if NOTHING_BUT_ROS not in path.parents:
            yield ".".join(["rled_msgs_py", *path.relative_to(PACKAGE).with_suffix("").parts])


def run(program):
    poison = f"import sys; sys.modules |= dict.fromkeys({BLOCKED!r})\n"
    command = [sys.executable, "-c", poison + program]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_all_but_one_folder_imports_without_ros():
    done = run("\n".join(f"import {module}" for module in modules_without_ros()))
    assert (done.returncode, done.stderr) == (0, "")


def test_nothing_outside_that_folder_imports_it():
    for path in PACKAGE.rglob("*.py"):
        if NOTHING_BUT_ROS not in path.parents:
            found = [
                node.module or "" for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)
            ]
            assert not [each for each in found if each.startswith("rled_msgs_py.ros")], path


def test_a_bag_is_read_without_ros(tmp_path):
    path = write_bag(tmp_path / "bag", ticks=3)
    program = f"""
from rled_msgs_py.bags import Bag
from rled_msgs_py.topics import EE_POSE, JOINT_STATES
bag = Bag({str(path)!r})
print(bag.task.robot, bag.message_count, len(list(bag.ticks())), bag.joints(JOINT_STATES).position.shape)
"""
    done = run(program)
    assert (done.stdout, done.stderr) == ("planar 17 3 (3, 2)\n", "")


def test_the_blockade_works():
    assert "ModuleNotFoundError" in run("import rled_msgs_py.ros.convert").stderr
