"""Node: serves a page to drive, watch and record on."""

from functools import partial

from rclpy.node import Node
from rled_msgs_py.node import run_node

from rled_teleop.web.serving import serve
from rled_teleop.web_params import WebParams


def main() -> None:
    """Run the node."""
    summary = "Serve a page to drive, watch and record on; --robot NAME starts all that it needs."
    run_node(partial(Node, "teleop_web"), WebParams, "teleop_web", summary, serve)


if __name__ == "__main__":
    main()
