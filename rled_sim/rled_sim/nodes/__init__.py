"""What imports ROS: the simulation node, and what it draws."""
