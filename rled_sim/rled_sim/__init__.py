"""PyBullet world, robots, tasks, Gymnasium environments and the simulation node.

Importing it registers ``rled/PandaReach-v0`` and ``rled/PlanarReach-v0`` with Gymnasium, by name: neither PyBullet nor
ROS is loaded before an environment is made or the node starts.
"""

from gymnasium.envs.registration import register

register("rled/PandaReach-v0", entry_point="rled_sim.faulty_env:make_reach", kwargs={"robot": "panda"})
register("rled/PlanarReach-v0", entry_point="rled_sim.faulty_env:make_reach", kwargs={"robot": "planar"})
