"""Who demonstrates: the scripted operator, and the devices of a person. No ROS."""
