"""Installs with pip and with colcon; ROS itself (rclpy, messages) is named in package.xml, never here."""

from setuptools import find_packages, setup

NAME = "rled_agent"

setup(
    name=NAME,
    version="0.1.0",
    description="Networks, learning from demonstrations, and the agent node.",
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
        "gymnasium",
        "matplotlib",
        "numpy",
        "rled_msgs_py",
        "rled_sim",
        "rled_teleop",
        "safetensors",
        "scipy",
        "tensorboard",
        "torch",
        "tqdm",
        "tyro",
    ],
    extras_require={"peers": ["stable-baselines3"], "ray": ["ray[default]"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "train_expert = rled_msgs_py.starting:rled_agent.cli.train_expert",
            "train_agent = rled_msgs_py.starting:rled_agent.cli.train_agent",
            "evaluate_agent = rled_msgs_py.starting:rled_agent.cli.evaluate_agent",
            "train_baseline = rled_msgs_py.starting:rled_agent.cli.train_baseline",
            "reproduce = rled_msgs_py.starting:rled_agent.experiments.reproduce",
            "draw_figures = rled_msgs_py.starting:rled_agent.experiments.draw_figures",
            "watch_episodes = rled_msgs_py.starting:rled_agent.nodes.watch_episodes",
            "agent_node = rled_msgs_py.starting:rled_agent.nodes.agent_node",
            "demo = rled_msgs_py.starting:rled_agent.cli.demo",
        ]
    },
)
