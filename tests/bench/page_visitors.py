"""Visitors of the page in a process of their own, so that what they read costs the measuring process nothing.

The first holds "To the target", the last one floods the page if it is asked to.
"""

import argparse

from rled_msgs_py.stopping import stop_requested
from viser import _messages as messages

from ..web.socket_visitor import SocketVisitor

NONSENSE = messages.LocalStorageGetItemResponseMessage("x" * 1000, None, "none")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("address")
    parser.add_argument("count", type=int)
    parser.add_argument("--flood", action="store_true")
    options = parser.parse_args()
    visitors = [SocketVisitor(options.address) for _ in range(options.count)]
    visitors[0].find("y +")
    with stop_requested() as stop, visitors[0].holding("To the target"):
        if options.flood:
            visitors[-1].begin_flood(NONSENSE)
        print("there", flush=True)
        stop.wait()


if __name__ == "__main__":
    main()
