"""PyBullet world, robots, tasks, Gymnasium environments and the simulation node."""
