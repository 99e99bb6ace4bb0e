"""Driving a robot with what was learned, and learning on beside it; no ROS in here."""
