"""Command ``repair_bag``: complete a bag whose recorder was killed."""

import argparse
from pathlib import Path

from rled_msgs_py.bags import repair
from rled_msgs_py.errors import command_line


@command_line
def main() -> None:
    """Repair the bag that the command line names, and say what was lost."""
    summary = "Complete a bag whose recorder was killed, or save what is whole of a damaged one."
    parser = argparse.ArgumentParser(prog="repair_bag", description=summary)
    parser.add_argument("bag", type=Path, help="a bag's folder or an .mcap file")
    path = parser.parse_args().bag
    messages, lost = repair(path)
    for part in lost:
        print(f"lost: {part}")
    print(f"{path} is complete and holds {messages} messages")


if __name__ == "__main__":
    main()
