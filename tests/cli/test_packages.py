"""What the packages say of themselves: dependencies, versions, executables, and what an import brings along."""

import ast
import re
import subprocess
import sys
from importlib import import_module
from importlib.metadata import distribution, packages_distributions, requires, version
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("rled_msgs_py", "rled_sim", "rled_teleop", "rled_agent")
ROS = re.compile(r"rclpy|rosbag2_py|ament_index_python|.*_(msgs|interfaces|srvs)")
ROSDEP_KEYS = {"evdev", "matplotlib", "numpy", "scipy", "tqdm", "yaml"}
OPTIONAL = {"evdev": "evdev-binary", "ray": "ray", "stable_baselines3": "stable-baselines3"}
"""Imported where it is used, with an error in one line when it is missing; an extra of its package names it."""


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
    assert required_by(package) == distributions_of(imported - OPTIONAL.keys())
    assert required_by(package, extra=True) == {OPTIONAL[each] for each in imported & OPTIONAL.keys()}


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
