"""Command: look into recorded demonstrations, check them, draw them, and make new bags of them."""

import sys
from typing import Protocol

import tyro
from rled_msgs_py.errors import command_line

from rled_teleop.cli.check import Check
from rled_teleop.cli.edit import Drop, Merge, Repair, Trim
from rled_teleop.cli.info import Info
from rled_teleop.cli.plot import Plot


class Command(Protocol):
    """One subcommand, with its options as fields."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        ...


@command_line
def main() -> None:
    """Run the command."""
    about = "Look into recorded demonstrations, check them, draw them, and make new bags of them."
    command: Command = tyro.cli(Info | Check | Plot | Trim | Merge | Drop | Repair, prog="demos", description=about)
    code = command.run()
    if code:
        sys.exit(code)


if __name__ == "__main__":
    main()
