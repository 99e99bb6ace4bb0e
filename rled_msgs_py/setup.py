"""Installs with pip and with colcon; ROS itself (rclpy, messages) is named in package.xml, never here."""

from setuptools import find_packages, setup

NAME = "rled_msgs_py"

setup(
    name=NAME,
    version="0.1.0",
    description="The contract of the RLED graph: topics, QoS, records with units, messages and bags.",
    license="Apache-2.0",
    maintainer="RLED maintainers",
    maintainer_email="maintainers@rled.invalid",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["lz4", "matplotlib", "mcap", "numpy", "pyyaml", "rosbags", "zstandard"],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "security_policy = rled_msgs_py.starting:rled_msgs_py.ros.security_policy",
        ]
    },
)
