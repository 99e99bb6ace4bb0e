"""The workspace builds with colcon, and its executables are where ``ros2 run`` looks for them."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.ros.node import fresh_context, spin_until, subscribe
from rled_msgs_py.topics import JOINT_STATES
from rled_sim.robots import ROBOTS

ROOT = Path(__file__).parents[2]
EXECUTABLES = {
    package: sorted(each.name for each in distribution(package).entry_points.select(group="console_scripts"))
    for package in ("rled_msgs_py", "rled_sim", "rled_teleop", "rled_agent")
}
BIN = Path(sys.executable).parent


def sourced(workspace: Path, *command: str | Path) -> list[str]:
    """A command line that runs with the built workspace on the paths, as in a terminal of a ROS user."""
    setup = shlex.quote(str(workspace / "install" / "setup.bash"))
    return ["bash", "-c", f"source {setup} && exec {shlex.join(map(str, command))}"]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    copy = tmp_path_factory.mktemp("clone")
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "build", "install", "log")
    for folder in ("rled_msgs_py", "rled_sim", "rled_teleop", "rled_agent", "ros_ws"):
        shutil.copytree(ROOT / folder, copy / folder, symlinks=True, ignore=ignored)
    environment = os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}", "COLCON_HOME": str(copy)}
    built = subprocess.run(["colcon", "build"], cwd=copy / "ros_ws", env=environment, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    return copy / "ros_ws"


def prefix_of(workspace: Path, package: str) -> Path:
    """Where the ament index finds a package; `ros2 run` takes executables from lib/<package> below it."""
    ask = f"from ament_index_python.packages import get_package_prefix as p; print(p({package!r}))"
    found = subprocess.run(sourced(workspace, sys.executable, "-c", ask), capture_output=True, text=True, check=True)
    return Path(found.stdout.strip())


@pytest.mark.parametrize("package", EXECUTABLES)
def test_executables_are_where_ros2_run_looks(workspace: Path, package: str) -> None:
    folder = prefix_of(workspace, package) / "lib" / package
    assert folder.is_relative_to(workspace / "install")
    executables = sorted(each.name for each in folder.iterdir() if os.access(each, os.X_OK))
    assert executables == EXECUTABLES[package]


@pytest.mark.parametrize("package", EXECUTABLES)
def test_an_executable_of_the_install_space_explains_itself(workspace: Path, package: str) -> None:
    name = EXECUTABLES[package][0]
    command = sourced(workspace, prefix_of(workspace, package) / "lib" / package / name, "--help")
    shown = subprocess.run(command, cwd=workspace, capture_output=True, text=True, timeout=60)
    assert shown.returncode == 0, shown.stderr
    assert name in shown.stdout


def test_modules_and_data_come_from_the_install_space(workspace: Path) -> None:
    ask = "import rled_agent, rled_msgs_py, rled_sim, rled_teleop as t; print(rled_sim.__file__, t.__file__)"
    shown = subprocess.run(sourced(workspace, sys.executable, "-c", ask), cwd=workspace, capture_output=True, text=True)
    assert all(Path(each).is_relative_to(workspace / "install") for each in shown.stdout.split())
    assert list(workspace.glob("install/rled_sim/lib/python3*/site-packages/rled_sim/urdf/*.urdf"))
    share = prefix_of(workspace, "rled_sim") / "share"
    named = re.findall('package://([^"]+)', "".join(robot.description for robot in ROBOTS.values()))
    assert named
    assert all((share / each).is_file() for each in named)


def test_launch_files_and_parameters_are_installed(workspace: Path) -> None:
    share = prefix_of(workspace, "rled_bringup") / "share" / "rled_bringup"
    source = workspace / "src" / "rled_bringup"
    for folder in ("launch", "config", "rviz"):
        names = sorted(each.name for each in (source / folder).iterdir())
        assert sorted(each.name for each in (share / folder).iterdir()) == names


def test_a_node_of_the_install_space_publishes_and_ends_on_sigint(workspace: Path) -> None:
    sim_node = prefix_of(workspace, "rled_sim") / "lib" / "rled_sim" / "sim_node"
    context = fresh_context()
    node = Node("listener", context=context)
    heard = []
    subscribe(node, JOINT_STATES, heard.append)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    with subprocess.Popen(sourced(workspace, sim_node, "--robot", "planar"), cwd=workspace) as sim:
        try:
            spin_until(executor, lambda: bool(heard), 30, "joint_states")
            sim.send_signal(signal.SIGINT)
            assert sim.wait(timeout=10) == 0
        finally:
            sim.kill()
            node.destroy_node()
            context.try_shutdown()
    assert heard[0].names == ("shoulder", "elbow")
