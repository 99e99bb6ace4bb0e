"""A page to drive, watch and record on, served by the node ``teleop_web``."""
