"""From received messages to a bag: order, episodes, filters, and what a bag holds. No ROS."""
