"""What each module may load, seen in a fresh interpreter."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rled_sim

PACKAGE = Path(rled_sim.__file__).parent
LOADED = "import sys; import {}; print(*(m for m in ('pybullet', 'rclpy', 'torch') if m in sys.modules))"


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.split(".")[0]


@pytest.mark.parametrize("module", ["", ".kinematics", ".robots", ".tasks", ".motion_guard", ".driver", ".vector.env"])
def test_module_loads_neither_pybullet_nor_ros(module):
    command = [sys.executable, "-c", LOADED.format(f"rled_sim{module}")]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == ""


def test_one_folder_imports_pybullet():
    assert {path.parent.name for path in PACKAGE.rglob("*.py") if "pybullet" in imports(path)} == {"bullet"}


def test_one_folder_imports_ros():
    ros = {"rclpy", "std_srvs", "std_msgs", "geometry_msgs", "visualization_msgs", "rosgraph_msgs", "sensor_msgs"}
    assert {path.parent.name for path in PACKAGE.rglob("*.py") if ros & set(imports(path))} == {"nodes"}


def test_importing_the_world_prints_nothing():
    done = subprocess.run(
        [sys.executable, "-c", "import rled_sim.bullet.world"], capture_output=True, text=True, check=True
    )
    assert done.stdout + done.stderr == ""
