"""Command ``robot_description``: the URDF of a robot, as the simulation publishes it, for tools that want a file."""

import argparse

from rled_msgs_py.errors import command_line

from rled_sim.robots import ROBOTS, robot_named


@command_line
def main() -> None:
    """Print the description of the robot that the command line names."""
    about = "Print a robot's URDF as sim_node publishes it, for robot_state_publisher and other tools."
    parser = argparse.ArgumentParser(prog="robot_description", description=about)
    parser.add_argument("robot", help=", ".join(ROBOTS))
    print(robot_named(parser.parse_args().robot).description, end="")


if __name__ == "__main__":
    main()
