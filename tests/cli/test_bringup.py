"""Launch files and parameter files agree with the nodes; they are read, not run: `launch` has no wheel."""

import ast
from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest
import yaml
from rled_agent.nodes.agent_node import AgentParams
from rled_msgs_py.bags import BagError, BagWriter
from rled_msgs_py.params import build, parameters_of
from rled_sim.nodes.sim_node import SimParams
from rled_sim.robots import ROBOTS
from rled_teleop.nodes.replay_demos import ReplayParams
from rled_teleop.nodes.teleop_gamepad import GamepadParams
from rled_teleop.nodes.teleop_keyboard import KeyboardParams
from rled_teleop.nodes.teleop_kinesthetic import KinestheticParams
from rled_teleop.nodes.teleop_scripted import ScriptedParams
from rled_teleop.recording.params import RecordParams
from rled_teleop.web.params import WebParams

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


def calls_of(file: Path, name: str) -> Iterator[tuple[ast.Call, dict[str, ast.expr]]]:
    """Each call `name(...)` in a launch file, and its keyword arguments."""
    for call in ast.walk(ast.parse(file.read_text())):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == name:
            yield call, {each.arg or "": each.value for each in call.keywords}


def arguments_of(file: Path) -> dict[str, dict[str, ast.expr]]:
    """What a launch file declares of each of its arguments."""
    return {ast.literal_eval(call.args[0]): given for call, given in calls_of(file, "DeclareLaunchArgument")}


def nodes_of(file: Path) -> Iterator[dict[str, Any]]:
    """Package, executable and the names of the parameters given to each of our `Node(...)` of a launch file."""
    for call, given in calls_of(file, "Node"):
        keys = [key.value for each in ast.walk(call) if isinstance(each, ast.Dict) for key in each.keys]
        if isinstance(given["package"], ast.Constant) and given["package"].value != "rviz2":
            yield {
                "package": ast.literal_eval(given["package"]),
                "executable": ast.literal_eval(given["executable"]),
                "parameters": keys,
            }


def test_there_are_launch_files_for_record_drive_demo_teleop_and_the_page() -> None:
    names = ["demo", "drive", "record", "robot_state", "teleop", "web"]
    assert [each.name.partition(".")[0] for each in LAUNCH_FILES] == names


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_launch_file_compiles_and_describes_a_launch(file: Path) -> None:
    tree = ast.parse(file.read_text())
    compile(tree, file, "exec")
    assert "generate_launch_description" in {each.name for each in tree.body if isinstance(each, ast.FunctionDef)}


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_launch_file_starts_executables_that_exist(file: Path) -> None:
    nodes = list(nodes_of(file))
    assert nodes or "robot_state" in file.name  # whose nodes are ROS's own
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
        if node.removeprefix("/**/") in ("robot_state_publisher", "rviz"):
            assert section["ros__parameters"]["use_sim_time"] is True  # stamps are simulation time
            continue
        params = PARAMS[NODE_NAMES[node.removeprefix("/**/")]]
        values = section["ros__parameters"]
        record = build(params, values)
        for each in parameters_of(params):
            assert type(getattr(record, each.name)) is type(each.default), each.name


def test_each_launch_file_has_a_parameter_file() -> None:
    assert [each.stem for each in CONFIGS] == [each.name.removesuffix(".launch.py") for each in LAUNCH_FILES]


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_an_argument_that_is_one_of_some_words_names_them_as_choices(file: Path) -> None:
    for name, given in arguments_of(file).items():
        if name in ("operator", "frames", "overwrite", "rviz"):
            assert ast.literal_eval(given["default_value"]) in ast.literal_eval(given["choices"])
        description = ast.literal_eval(given["description"])
        assert "true" not in description
        assert " or none" not in description


def test_the_operators_of_teleop_are_those_that_it_starts_and_none() -> None:
    (file,) = (each for each in LAUNCH_FILES if each.name.startswith("teleop"))
    started = [ast.literal_eval(call.args[0]) for call, _ in calls_of(file, "chosen")]
    assert ast.literal_eval(arguments_of(file)["operator"]["choices"]) == [*started, "none"]


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_robots_are_listed_by_the_simulation_alone(file: Path) -> None:
    (given,) = [given for name, given in arguments_of(file).items() if name == "robot"]
    assert ast.literal_eval(given["default_value"]) in ROBOTS
    assert not any(robot in ast.literal_eval(given["description"]) for robot in ROBOTS)
    robot = next(each for each in parameters_of(SimParams) if each.name == "robot")
    assert robot.spec.choices == tuple(ROBOTS)


def test_what_an_existing_bag_is_answered_with_is_an_argument_of_each_launch_file_that_records(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").touch()
    with pytest.raises(BagError, match="overwrite:=true in a launch file"):
        BagWriter(tmp_path / "bag")
    for file in LAUNCH_FILES:
        recorders = [node for node in nodes_of(file) if node["executable"] == "record_demos"]
        if recorders and "demo" not in file.name:
            assert "overwrite" in arguments_of(file)
            assert "overwrite" in recorders[0]["parameters"]
    assert yaml.safe_load((BRINGUP / "config" / "demo.yaml").read_text())["/**/record_demos"]["ros__parameters"][
        "overwrite"
    ]


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_every_launch_file_gives_the_frames_of_the_robot_once(file: Path) -> None:
    included = [ast.unparse(call.args[0]) for call, _ in calls_of(file, "IncludeLaunchDescription")]
    frames = [each for each in included if "robot_state.launch.py" in each]
    assert len(frames) == (0 if "robot_state" in file.name else 1)
    # An included file shares the arguments of the one that includes it: this would change whose config is read.
    (state,) = (each for each in LAUNCH_FILES if "robot_state" in each.name)
    assert set(arguments_of(state)) == {"robot", "rviz"}
