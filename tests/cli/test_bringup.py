"""Launch files and parameter files agree with the nodes; they are read, not run: `launch` has no wheel."""

import ast
from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest
import yaml
from rled_agent.agent_node import AgentParams
from rled_msgs_py.params import build, parameters_of
from rled_sim.sim_node import SimParams
from rled_teleop.record_params import RecordParams
from rled_teleop.replay_demos import ReplayParams
from rled_teleop.teleop_gamepad import GamepadParams
from rled_teleop.teleop_keyboard import KeyboardParams
from rled_teleop.teleop_kinesthetic import KinestheticParams
from rled_teleop.teleop_scripted import ScriptedParams
from rled_teleop.web_params import WebParams

BRINGUP = Path(__file__).parents[2] / "ros_ws" / "src" / "rled_bringup"
LAUNCH_FILES = sorted(BRINGUP.glob("launch/*.launch.py"))
CONFIGS = sorted(BRINGUP.glob("config/*.yaml"))
PARAMS = {
    "sim_node": SimParams,
    "teleop_scripted": ScriptedParams,
    "teleop_keyboard": KeyboardParams,
    "teleop_gamepad": GamepadParams,
    "teleop_kinesthetic": KinestheticParams,
    "teleop_web": WebParams,
    "replay_demos": ReplayParams,
    "record_demos": RecordParams,
    "agent_node": AgentParams,
}
NODE_NAMES = {"sim": "sim_node"} | {name: name for name in PARAMS if name != "sim_node"}


def nodes_of(file: Path) -> Iterator[dict[str, Any]]:
    """Package, executable and the names of the parameters given to each `Node(...)` of a launch file."""
    for call in ast.walk(ast.parse(file.read_text())):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "Node":
            given = {each.arg: each.value for each in call.keywords}
            keys = [key.value for each in ast.walk(call) if isinstance(each, ast.Dict) for key in each.keys]
            yield {
                "package": ast.literal_eval(given["package"]),
                "executable": ast.literal_eval(given["executable"]),
                "parameters": keys,
            }


def test_there_are_launch_files_for_record_drive_demo_teleop_and_the_page() -> None:
    assert [each.name.partition(".")[0] for each in LAUNCH_FILES] == ["demo", "drive", "record", "teleop", "web"]


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_launch_file_compiles_and_describes_a_launch(file: Path) -> None:
    tree = ast.parse(file.read_text())
    compile(tree, file, "exec")
    assert "generate_launch_description" in {each.name for each in tree.body if isinstance(each, ast.FunctionDef)}


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_launch_file_starts_executables_that_exist(file: Path) -> None:
    nodes = list(nodes_of(file))
    assert nodes
    for node in nodes:
        scripts = distribution(node["package"]).entry_points.select(group="console_scripts")
        assert node["executable"] in {each.name for each in scripts}


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_launch_file_gives_declared_parameters(file: Path) -> None:
    for node in nodes_of(file):
        declared = {each.name for each in parameters_of(PARAMS[node["executable"]])}
        assert declared.issuperset(node["parameters"])


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_launch_file_uses_the_arguments_that_it_declares(file: Path) -> None:
    calls = [each for each in ast.walk(ast.parse(file.read_text())) if isinstance(each, ast.Call)]

    def named_in(*functions: str) -> set[str]:
        called = [each for each in calls if isinstance(each.func, ast.Name) and each.func.id in functions]
        return {each.args[0].value for each in called if isinstance(each.args[0], ast.Constant)}

    assert named_in("DeclareLaunchArgument") == named_in("LaunchConfiguration", "given")


@pytest.mark.parametrize("file", CONFIGS, ids=lambda file: file.name)
def test_parameter_file_has_values_that_its_nodes_accept(file: Path) -> None:
    sections = yaml.safe_load(file.read_text())
    assert sections
    for node, section in sections.items():
        params = PARAMS[NODE_NAMES[node.removeprefix("/**/")]]
        values = section["ros__parameters"]
        record = build(params, values)
        for each in parameters_of(params):
            assert type(getattr(record, each.name)) is type(each.default), each.name


def test_each_launch_file_has_a_parameter_file() -> None:
    assert [each.stem for each in CONFIGS] == [each.name.removesuffix(".launch.py") for each in LAUNCH_FILES]
