#!/bin/bash
# Puts ROS and the workspace on the paths, then runs the command given.
set -e
source /opt/ros/jazzy/setup.bash
source /rled/ros_ws/install/setup.bash
exec "$@"
