"""Robot state: the frames of the robot's links, for RViz and Foxglove, beside a simulation or a bag that is played.

The other launch files include it. Beside a bag: start this, then `ros2 bag play --clock BAG`.
"""

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_directory
from launch import Action, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo
from launch.conditions import IfCondition
from launch.substitutions import Command, FindExecutable, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(get_package_share_directory("rled_bringup"))
CONFIG = str(SHARE / "config" / "robot_state.yaml")
"""No argument: the files that include this one have another of that name."""
PACKAGE = "robot_state_publisher"
ARGUMENTS = (
    DeclareLaunchArgument("robot", default_value="panda", description="a robot that sim_node has; --help lists them"),
    DeclareLaunchArgument("rviz", default_value="false", choices=["true", "false"], description="start RViz as well"),
)


def publisher() -> Action:
    """Frames from joint_states, or a word where the package is not installed."""
    try:
        get_package_prefix(PACKAGE)
    except PackageNotFoundError:
        return LogInfo(msg=f"{PACKAGE} is not installed: RViz has no frames to draw the robot in")
    words = [FindExecutable(name="ros2"), " run rled_sim robot_description ", LaunchConfiguration("robot")]
    description = ParameterValue(Command(words, on_stderr="warn"), value_type=str)
    return Node(
        package=PACKAGE,
        executable="robot_state_publisher",
        parameters=[CONFIG, {"robot_description": description}],
        remappings=[("robot_description", "~/robot_description")],  # the simulation's, or the bag's, is the one
    )


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch rled_bringup robot_state.launch.py` starts."""
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", str(SHARE / "rviz" / "rled.rviz")],
        parameters=[CONFIG],
        condition=IfCondition(LaunchConfiguration("rviz")),
    )
    return LaunchDescription([*ARGUMENTS, publisher(), rviz])
