"""Installs with pip and with colcon; ROS itself (rclpy, messages) is named in package.xml, never here."""

from setuptools import find_packages, setup

NAME = "rled_teleop"

setup(
    name=NAME,
    version="0.1.0",
    description="Operators that drive the robot, and the recorder of demonstrations.",
    license="Apache-2.0",
    maintainer="RLED maintainers",
    maintainer_email="maintainers@rled.invalid",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=[
        "msgspec",
        "numpy",
        "rled_msgs_py",
        "rled_sim",
        "tqdm",
        "tyro",
        "viser",
        "websockets",
        "yourdfpy",
    ],
    extras_require={"gamepad": ["evdev-binary"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "teleop_scripted = rled_msgs_py.starting:rled_teleop.nodes.teleop_scripted",
            "teleop_keyboard = rled_msgs_py.starting:rled_teleop.nodes.teleop_keyboard",
            "demos = rled_msgs_py.starting:rled_teleop.cli.demos",
            "teleop_gamepad = rled_msgs_py.starting:rled_teleop.nodes.teleop_gamepad",
            "teleop_kinesthetic = rled_msgs_py.starting:rled_teleop.nodes.teleop_kinesthetic",
            "replay_demos = rled_msgs_py.starting:rled_teleop.nodes.replay_demos",
            "teleop_web = rled_msgs_py.starting:rled_teleop.nodes.teleop_web",
            "web_operator = rled_msgs_py.starting:rled_teleop.nodes.web_operator",
            "record_demos = rled_msgs_py.starting:rled_teleop.nodes.record_demos",
        ]
    },
)
