"""PyBullet world, robots, tasks, Gymnasium environments and the simulation node.

Importing it registers ``rled/PandaReach-v0`` and ``rled/PlanarReach-v0`` with Gymnasium, by name: neither PyBullet nor
ROS is loaded before an environment is made or the node starts.
"""

from gymnasium.envs.registration import register

ENVIRONMENTS = {"panda": "rled/PandaReach-v0", "planar": "rled/PlanarReach-v0"}
"""Gymnasium's name of the environment of each robot that has one, by the robot's name."""

for robot, name in ENVIRONMENTS.items():
    register(
        name,
        entry_point="rled_sim.faulty_env:make_reach",
        vector_entry_point="rled_sim.vector.env:ReachVectorEnv",
        kwargs={"robot": robot},
    )
