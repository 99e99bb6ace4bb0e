"""Installs with pip and with colcon; ROS itself (rclpy, messages) is named in package.xml, never here."""

from setuptools import find_packages, setup

NAME = "rled_sim"

setup(
    name=NAME,
    version="0.1.0",
    description="PyBullet world, robots, tasks, Gymnasium environments and the simulation node.",
    license="Apache-2.0",
    maintainer="RLED maintainers",
    maintainer_email="maintainers@rled.invalid",
    python_requires=">=3.11",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["urdf/*.urdf"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["gymnasium", "numpy", "pybullet", "rled_msgs_py"],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "sim_node = rled_msgs_py.starting:rled_sim.sim_node",
        ]
    },
)
