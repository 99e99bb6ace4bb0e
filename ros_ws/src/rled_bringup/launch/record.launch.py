"""Record a demonstration: simulation, scripted operator, recorder; all end when the operator has finished."""

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
    DeclareLaunchArgument("bag", default_value="out/bag", description="folder of the bag to write"),
    DeclareLaunchArgument(
        "overwrite", default_value="false", choices=["true", "false"], description="replace the bag if there is one"
    ),
    DeclareLaunchArgument("robot", default_value="panda", description="a robot that sim_node has; --help lists them"),
    DeclareLaunchArgument(
        "frames", default_value="true", choices=["true", "false"], description="frames of the links, for RViz"
    ),
    DeclareLaunchArgument("points", default_value="0", description="points of the curve to mark; 0: all"),
    DeclareLaunchArgument("trajectories", default_value="50", description="targets to reach after that"),
    DeclareLaunchArgument(
        "config", default_value=str(SHARE / "config" / "record.yaml"), description="parameters of the nodes"
    ),
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
        parameters=[config, {"output": given("bag", str), "overwrite": given("overwrite", bool)}],
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
    links = IncludeLaunchDescription(
        str(SHARE / "launch" / "robot_state.launch.py"), condition=IfCondition(LaunchConfiguration("frames"))
    )
    return LaunchDescription([*ARGUMENTS, links, sim, recorder, operator])
