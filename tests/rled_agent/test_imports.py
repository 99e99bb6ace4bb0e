"""The core learns from a bag on a machine without ROS and without a simulator."""

import ast
import subprocess
import sys
from pathlib import Path

import rled_agent

PACKAGE = Path(rled_agent.__file__).parent
NODES = {"agent_node", "graph_env", "live_demonstrations", "restart", "watch_episodes"}
ROS = {"rclpy", "std_srvs", "std_msgs", "rcl_interfaces", "sensor_msgs", "geometry_msgs", "diagnostic_msgs"}
CORE = sorted(each.stem for each in PACKAGE.glob("*.py") if each.stem not in NODES | {"__init__"})


def imported_by(path: Path) -> set[str]:
    tree = ast.walk(ast.parse(path.read_text()))
    return {alias.name.partition(".")[0] for node in tree if isinstance(node, ast.Import) for alias in node.names} | {
        node.module.partition(".")[0]
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module
    }


def test_every_module_but_the_nodes_imports_without_ros_and_pybullet():
    """The commands too: train_agent needs ROS only to train over the graph, and pybullet only to open a robot."""
    modules = [f"rled_agent.{name}" for name in CORE] + ["rled_msgs_py.bags"]
    program = f"""
import sys
sys.modules.update(rclpy=None, pybullet=None)
import {", ".join(modules)}
foreign = {{name.partition(".")[0] for name in sys.modules}} & {ROS - {"rclpy"}!r}
assert not foreign, foreign
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_only_the_nodes_import_ros():
    assert {path.stem for path in PACKAGE.glob("*.py") if ROS & imported_by(path)} == NODES


def test_nothing_imports_pybullet_or_the_world():
    for path in PACKAGE.glob("*.py"):
        assert "pybullet" not in imported_by(path), path
        assert "rled_sim.bullet" not in path.read_text(), path


def test_no_module_loads_a_pickle():
    for path in PACKAGE.glob("*.py"):
        assert not {"pickle", "shelve", "dill", "joblib"} & imported_by(path), path
        assert "torch.load" not in path.read_text(), path
