"""The world that PyBullet simulates: the only folder that imports PyBullet."""

from rled_sim.bullet.quiet import quiet

with quiet():  # it prints when it was built, which would stand beside a command's one line
    import pybullet  # noqa: F401
