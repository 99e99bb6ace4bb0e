"""Teleop: simulation in real time, recorder, and a person with a gamepad or another arm.

The keyboard operator needs a terminal of its own: start this with `operator:=none`, and `teleop_keyboard` beside it.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(get_package_share_directory("rled_bringup"))
ARGUMENTS = (
    DeclareLaunchArgument(
        "operator", default_value="gamepad", choices=["gamepad", "kinesthetic", "none"], description="who drives"
    ),
    DeclareLaunchArgument("bag", default_value="out/by_hand", description="folder of the bag to write"),
    DeclareLaunchArgument(
        "overwrite", default_value="false", choices=["true", "false"], description="replace the bag if there is one"
    ),
    DeclareLaunchArgument("robot", default_value="panda", description="a robot that sim_node has; --help lists them"),
    DeclareLaunchArgument(
        "frames", default_value="true", choices=["true", "false"], description="frames of the links, for RViz"
    ),
    DeclareLaunchArgument("person", default_value="", description="who demonstrates, said with each episode"),
    DeclareLaunchArgument("device", default_value="", description="gamepad: auto or a path; empty: the topic joy"),
    DeclareLaunchArgument("mapping", default_value="", description="kinesthetic: from the device's joints, YAML"),
    DeclareLaunchArgument(
        "config", default_value=str(SHARE / "config" / "teleop.yaml"), description="parameters of the nodes"
    ),
)


def given(name: str, value_type: type = str) -> ParameterValue:
    """A launch argument as the value of a parameter."""
    return ParameterValue(LaunchConfiguration(name), value_type=value_type)


def chosen(operator: str) -> IfCondition:
    """Whether an operator is the one asked for."""
    return IfCondition(EqualsSubstitution(LaunchConfiguration("operator"), operator))


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch rled_bringup teleop.launch.py` starts."""
    config = LaunchConfiguration("config")
    sim = Node(
        package="rled_sim",
        executable="sim_node",
        parameters=[config, {"robot": given("robot")}],
        output="screen",
        on_exit=Shutdown(reason="the simulation has ended"),
    )
    recorder = Node(
        package="rled_teleop",
        executable="record_demos",
        parameters=[
            config,
            {"output": given("bag"), "overwrite": given("overwrite", bool), "operator_name": given("person")},
        ],
        output="screen",
        on_exit=Shutdown(reason="the recorder has ended"),
    )
    gamepad = Node(
        package="rled_teleop",
        executable="teleop_gamepad",
        parameters=[config, {"device": given("device")}],
        output="screen",
        condition=chosen("gamepad"),
        on_exit=Shutdown(reason="the operator has ended"),
    )
    other_arm = Node(
        package="rled_teleop",
        executable="teleop_kinesthetic",
        parameters=[config, {"mapping": given("mapping")}],
        output="screen",
        condition=chosen("kinesthetic"),
        on_exit=Shutdown(reason="the operator has ended"),
    )
    links = IncludeLaunchDescription(
        str(SHARE / "launch" / "robot_state.launch.py"), condition=IfCondition(LaunchConfiguration("frames"))
    )
    return LaunchDescription([*ARGUMENTS, links, sim, recorder, gamepad, other_arm])
