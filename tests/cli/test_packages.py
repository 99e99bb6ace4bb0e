"""The packages: dependencies, versions, executables, what an import brings along, the workspace that colcon builds."""

import ast
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from importlib import import_module
from importlib.metadata import distribution, packages_distributions, requires, version
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rled_msgs_py.ros.node import fresh_context, spin_until, subscribe
from rled_msgs_py.topics import JOINT_STATES
from rled_sim.robots import ROBOTS

ROOT = Path(__file__).parents[2]
PACKAGES = ("rled_msgs_py", "rled_sim", "rled_teleop", "rled_agent")
ROS = re.compile(r"rclpy|rosbag2_py|ament_index_python|.*_(msgs|interfaces|srvs)")
ROSDEP_KEYS = {"evdev", "matplotlib", "numpy", "scipy", "tqdm", "yaml"}
OPTIONAL = {"evdev": "evdev-binary", "ray": "ray", "stable_baselines3": "stable-baselines3"}
"""Imported where it is used, with an error in one line when it is missing; an extra of its package names it."""
OPTIONAL_OF = {"rled_sim": {"torch": "torch"}}
"""The same of one package only."""


def imports_of(package: str) -> set[str]:
    """Top-level modules outside the standard library that a package's files import or name, its own less."""
    trees = [ast.parse(each.read_text()) for each in (ROOT / package / package).rglob("*.py")]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and not node.level}
    names |= {"tensorboard" for name in names if name.startswith("torch.utils.tensorboard")}
    names |= {node.value for node in nodes if isinstance(node, ast.Constant) and node.value in PACKAGES}
    return {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) - {package}


def distributions_of(modules: set[str]) -> set[str]:
    """Names on PyPI, as PEP 503 writes them, of the distributions that provide modules."""
    provided = packages_distributions()
    return {re.sub(r"[-_.]+", "-", name).lower() for module in modules for name in provided[module][:1]}


def required_by(package: str, *, extra: bool = False) -> set[str]:
    lines = [each for each in requires(package) or [] if ("extra ==" in each) == extra]
    return {re.sub(r"[-_.]+", "-", re.split(r"[\s<>=!~;\[]", each)[0]).lower() for each in lines}


def manifest_of(package: str) -> ElementTree.Element:
    return ElementTree.parse(ROOT / package / "package.xml").getroot()


def is_ros(module: str) -> bool:
    return bool(ROS.fullmatch(module))


@pytest.mark.parametrize("package", PACKAGES)
def test_pip_requirements_are_exactly_what_is_imported_less_ros(package: str) -> None:
    imported = {each for each in imports_of(package) if not is_ros(each)}
    optional = OPTIONAL | OPTIONAL_OF.get(package, {})
    assert required_by(package) == distributions_of(imported - optional.keys())
    assert required_by(package, extra=True) == {optional[each] for each in imported & optional.keys()}


@pytest.mark.parametrize("package", PACKAGES)
def test_package_xml_names_every_ros_package_that_is_imported(package: str) -> None:
    wanted = {each for each in imports_of(package) if is_ros(each) or each in PACKAGES}
    wanted |= {f"python3-{each}" for each in imports_of(package) & ROSDEP_KEYS}
    assert {each.text for each in manifest_of(package).iter("exec_depend")} == wanted


@pytest.mark.parametrize("package", PACKAGES)
def test_all_packages_carry_one_version_and_licence(package: str) -> None:
    manifest = manifest_of(package)
    assert manifest.findtext("version") == version(package) == version("rled_msgs_py")
    assert manifest.findtext("license") == "Apache-2.0"


@pytest.mark.parametrize("package", PACKAGES)
def test_executables_start_modules_that_have_a_main(package: str) -> None:
    for script in distribution(package).entry_points.select(group="console_scripts"):
        assert script.module == "rled_msgs_py.starting"
        assert callable(import_module(script.attr).main), script


def test_requirements_name_what_the_packages_require() -> None:
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    named = {re.split(r"[\s=<\[#]", line)[0] for line in lines} - {""}
    needed = {each for package in PACKAGES for each in required_by(package)} - {
        each.replace("_", "-") for each in PACKAGES
    }
    assert {each for each in named if not each.startswith("ros-jazzy")} == needed


def test_lock_pins_every_requirement_and_names_no_place() -> None:
    lines = [line for line in (ROOT / "requirements.lock").read_text().splitlines() if line and line[0] != "#"]
    assert all(re.fullmatch(r"[a-z0-9-]+==[0-9a-z.]+", line) for line in lines)
    pinned = {line.partition("==")[0] for line in lines}
    wanted = "\n".join((ROOT / name).read_text() for name in ("requirements.txt", "requirements-dev.txt")).splitlines()
    assert pinned.issuperset({re.split(r"[\s=<\[#]", line)[0] for line in wanted if line[:1].isalpha()})


@pytest.mark.parametrize("module", ["rled_msgs_py.bags", "rled_sim", "rled_sim.kinematics"])
def test_import_brings_neither_ros_nor_pybullet(module: str) -> None:
    program = f"import sys; sys.modules.update(rclpy=None, pybullet=None); import {module}"
    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT / "tests")


# The workspace builds with colcon, and its executables are where ``ros2 run`` looks for them.


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
