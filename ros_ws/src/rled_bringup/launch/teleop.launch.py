"""Teleop: simulation in real time, recorder, and a person with a gamepad or another arm.

The keyboard operator needs a terminal of its own: start this with `operator:=none`, and `teleop_keyboard` beside it.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

CONFIG = str(Path(get_package_share_directory("rled_bringup"), "config", "teleop.yaml"))
ARGUMENTS = (
    DeclareLaunchArgument("operator", default_value="gamepad", description="gamepad, kinesthetic or none"),
    DeclareLaunchArgument("bag", default_value="out/by_hand", description="folder of the bag to write"),
    DeclareLaunchArgument("robot", default_value="panda", description="panda or planar"),
    DeclareLaunchArgument("person", default_value="", description="who demonstrates, said with each episode"),
    DeclareLaunchArgument("device", default_value="", description="gamepad: auto or a path; empty: the topic joy"),
    DeclareLaunchArgument("mapping", default_value="", description="kinesthetic: from the device's joints, YAML"),
    DeclareLaunchArgument("config", default_value=CONFIG, description="parameters of the nodes"),
)


def given(name: str) -> ParameterValue:
    """A launch argument as the value of a text parameter."""
    return ParameterValue(LaunchConfiguration(name), value_type=str)


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
        parameters=[config, {"output": given("bag"), "operator_name": given("person")}],
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
    return LaunchDescription([*ARGUMENTS, sim, recorder, gamepad, other_arm])
