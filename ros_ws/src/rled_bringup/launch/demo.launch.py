"""From nothing to a driven robot: record a demonstration, learn the expert from the bag, drive until Ctrl-C."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import Action, LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, IncludeLaunchDescription, Shutdown
from launch.conditions import IfCondition
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(get_package_share_directory("rled_bringup"))
ARGUMENTS = (
    DeclareLaunchArgument("output", default_value="out/demo", description="folder of the bag and of what is learned"),
    DeclareLaunchArgument("robot", default_value="panda", description="a robot that sim_node has; --help lists them"),
    DeclareLaunchArgument(
        "frames", default_value="true", choices=["true", "false"], description="frames of the links, for RViz"
    ),
    DeclareLaunchArgument("trajectories", default_value="50", description="targets that the operator reaches"),
    DeclareLaunchArgument("config", default_value=str(SHARE / "config" / "demo.yaml"), description="parameters"),
)
BAG = PathJoinSubstitution([LaunchConfiguration("output"), "bag"])
EXPERT = PathJoinSubstitution([LaunchConfiguration("output"), "expert"])


def record() -> Node:
    """The first stage; it starts the simulation and the operator and ends with them."""
    return Node(
        package="rled_teleop",
        executable="record_demos",
        parameters=[
            LaunchConfiguration("config"),
            {
                "output": ParameterValue(BAG, value_type=str),
                "robot": ParameterValue(LaunchConfiguration("robot"), value_type=str),
                "trajectories": ParameterValue(LaunchConfiguration("trajectories"), value_type=int),
            },
        ],
        output="screen",
        on_exit=after_record,
    )


def after_record(event: ProcessExited, _: LaunchContext) -> Action:
    """Learn from the bag."""
    if event.returncode:
        return Shutdown(reason="recording failed")
    return ExecuteProcess(
        cmd=["ros2", "run", "rled_agent", "train_expert", "--bag", BAG, "--output", EXPERT],
        output="screen",
        on_exit=after_training,
    )


def after_training(event: ProcessExited, _: LaunchContext) -> Action:
    """Drive with what was learned."""
    if event.returncode:
        return Shutdown(reason="training failed")
    weights = PathJoinSubstitution([EXPERT, "expert.safetensors"])
    return IncludeLaunchDescription(
        str(SHARE / "launch" / "drive.launch.py"),
        launch_arguments={
            "expert": weights,
            "robot": LaunchConfiguration("robot"),
            "frames": "false",  # they are there
            "bag": BAG,
            "config": str(SHARE / "config" / "drive.yaml"),
        }.items(),
    )


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch rled_bringup demo.launch.py` starts."""
    links = IncludeLaunchDescription(
        str(SHARE / "launch" / "robot_state.launch.py"), condition=IfCondition(LaunchConfiguration("frames"))
    )
    return LaunchDescription([*ARGUMENTS, links, record()])
