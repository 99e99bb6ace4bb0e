"""Nodes: all of this package that imports ROS, and the programs that run it."""
