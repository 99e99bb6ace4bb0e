"""Web: simulation in real time and the page to drive, watch and record on."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(get_package_share_directory("rled_bringup"))
ARGUMENTS = (
    DeclareLaunchArgument("robot", default_value="panda", description="a robot that sim_node has; --help lists them"),
    DeclareLaunchArgument(
        "frames", default_value="true", choices=["true", "false"], description="frames of the links, for RViz"
    ),
    DeclareLaunchArgument("host", default_value="127.0.0.1", description="address to serve at; others want a token"),
    DeclareLaunchArgument("token", default_value="", description="word that opens the page; all users see it"),
    DeclareLaunchArgument("token_file", default_value="", description="file with that word, which nobody sees"),
    DeclareLaunchArgument(
        "config", default_value=str(SHARE / "config" / "web.yaml"), description="parameters of the nodes"
    ),
)


def given(name: str) -> ParameterValue:
    """A launch argument as the value of a text parameter."""
    return ParameterValue(LaunchConfiguration(name), value_type=str)


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch rled_bringup web.launch.py` starts."""
    config = LaunchConfiguration("config")
    sim = Node(
        package="rled_sim",
        executable="sim_node",
        parameters=[config, {"robot": given("robot")}],
        output="screen",
        on_exit=Shutdown(reason="the simulation has ended"),
    )
    page = Node(
        package="rled_teleop",
        executable="teleop_web",
        parameters=[config, {"host": given("host"), "token": given("token"), "token_file": given("token_file")}],
        output="screen",
        on_exit=Shutdown(reason="the page has ended"),
    )
    links = IncludeLaunchDescription(
        str(SHARE / "launch" / "robot_state.launch.py"), condition=IfCondition(LaunchConfiguration("frames"))
    )
    return LaunchDescription([*ARGUMENTS, links, sim, page])
