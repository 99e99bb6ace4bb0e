"""The contract is read without ROS and without a simulator."""

import subprocess
import sys

import pytest

from .samples import write_bag

BLOCKED = (
    "rclpy", "pybullet", "std_msgs", "sensor_msgs", "geometry_msgs", "diagnostic_msgs", "builtin_interfaces",
    "rcl_interfaces", "torch",
)  # fmt: skip
PURE = ("bags", "errors", "files", "messages", "params", "records", "task", "tick", "topics")


def run(program):
    poison = f"import sys; sys.modules |= dict.fromkeys({BLOCKED!r})\n"
    command = [sys.executable, "-c", poison + program]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("module", PURE)
def test_imports_without_ros(module):
    done = run(f"import rled_msgs_py.{module}")
    assert (done.returncode, done.stderr) == (0, "")


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
