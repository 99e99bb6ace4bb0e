"""Installs with pip and with colcon; ROS itself (rclpy, messages) is named in package.xml, never here."""

import os
from importlib.util import find_spec
from pathlib import Path

from setuptools import find_packages, setup

NAME = "rled_sim"


def robots() -> list[tuple[str, list[str]]]:
    """The meshes of PyBullet's robots, for tools that look for ``package://rled_sim/robots``; none without PyBullet."""
    found = find_spec("pybullet_data")
    if found is None or found.origin is None:
        return []
    data = Path(found.origin).parent
    files: dict[str, list[str]] = {}
    for file in sorted(each for each in (data / "franka_panda").rglob("*") if each.is_file()):
        place = f"share/{NAME}/robots/{file.parent.relative_to(data)}"
        files.setdefault(place, []).append(os.path.relpath(file, Path(__file__).parent))  # colcon refuses absolute ones
    return list(files.items())


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
        *robots(),
    ],
    install_requires=["gymnasium", "numpy", "pybullet", "rled_msgs_py"],
    extras_require={"torch": ["torch"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "sim_node = rled_msgs_py.starting:rled_sim.nodes.sim_node",
            "robot_description = rled_msgs_py.starting:rled_sim.robot_description",
        ]
    },
)
