"""The nodes, and an environment over their topics: the only ROS in this package."""
