"""Launch files, parameters and layouts; no module and no executable of its own."""

from glob import glob

from setuptools import setup

NAME = "rled_bringup"

setup(
    name=NAME,
    version="0.1.0",
    description="Launch files and parameters of the RLED graph.",
    license="Apache-2.0",
    maintainer="RLED maintainers",
    maintainer_email="maintainers@rled.invalid",
    packages=[],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
        (f"share/{NAME}/layouts", glob("layouts/*")),
        (f"share/{NAME}/rviz", glob("rviz/*.rviz")),
    ],
    zip_safe=False,
)
