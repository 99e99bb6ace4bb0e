"""Drive: simulation in real time and the agent with the expert that train_expert wrote."""

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
    DeclareLaunchArgument(
        "expert", default_value="out/expert/expert.safetensors", description="weights, or their folder"
    ),
    DeclareLaunchArgument("robot", default_value="panda", description="a robot that sim_node has; --help lists them"),
    DeclareLaunchArgument(
        "frames", default_value="true", choices=["true", "false"], description="frames of the links, for RViz"
    ),
    DeclareLaunchArgument("bag", default_value="", description="start at a point marked in this bag; empty: at home"),
    DeclareLaunchArgument(
        "config", default_value=str(SHARE / "config" / "drive.yaml"), description="parameters of the nodes"
    ),
)


def given(name: str) -> ParameterValue:
    """A launch argument as the value of a text parameter."""
    return ParameterValue(LaunchConfiguration(name), value_type=str)


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch rled_bringup drive.launch.py` starts."""
    config = LaunchConfiguration("config")
    sim = Node(
        package="rled_sim",
        executable="sim_node",
        parameters=[config, {"robot": given("robot"), "start_points": given("bag")}],
        output="screen",
        on_exit=Shutdown(reason="the simulation has ended"),
    )
    agent = Node(
        package="rled_agent",
        executable="agent_node",
        parameters=[config, {"expert": given("expert")}],
        output="screen",
        on_exit=Shutdown(reason="the agent has ended"),
    )
    links = IncludeLaunchDescription(
        str(SHARE / "launch" / "robot_state.launch.py"), condition=IfCondition(LaunchConfiguration("frames"))
    )
    return LaunchDescription([*ARGUMENTS, links, sim, agent])
