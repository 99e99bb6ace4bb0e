"""The contract in rclpy's terms. Nothing else in this package imports ROS."""
