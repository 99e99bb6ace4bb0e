"""Record a demonstration: simulation, scripted operator, recorder; all end when the operator has finished."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

CONFIG = str(Path(get_package_share_directory("rled_bringup"), "config", "record.yaml"))
ARGUMENTS = (
    DeclareLaunchArgument("bag", default_value="out/bag", description="folder of the bag to write"),
    DeclareLaunchArgument("robot", default_value="panda", description="panda or planar"),
    DeclareLaunchArgument("points", default_value="0", description="points of the curve to mark; 0: all"),
    DeclareLaunchArgument("trajectories", default_value="50", description="targets to reach after that"),
    DeclareLaunchArgument("config", default_value=CONFIG, description="parameters of the nodes"),
)


def given(name: str, value_type: type) -> ParameterValue:
    """A launch argument as the value of a parameter."""
    return ParameterValue(LaunchConfiguration(name), value_type=value_type)


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch rled_bringup record.launch.py` starts."""
    config = LaunchConfiguration("config")
    sim = Node(
        package="rled_sim",
        executable="sim_node",
        parameters=[config, {"robot": given("robot", str)}],
        on_exit=Shutdown(reason="the simulation has ended"),
    )
    recorder = Node(
        package="rled_teleop",
        executable="record_demos",
        parameters=[config, {"output": given("bag", str)}],
        output="screen",
        on_exit=Shutdown(reason="the recorder has ended"),
    )
    operator = Node(
        package="rled_teleop",
        executable="teleop_scripted",
        parameters=[config, {"points": given("points", int), "trajectories": given("trajectories", int)}],
        output="screen",
        on_exit=Shutdown(reason="the operator has finished"),
    )
    return LaunchDescription([*ARGUMENTS, sim, recorder, operator])
