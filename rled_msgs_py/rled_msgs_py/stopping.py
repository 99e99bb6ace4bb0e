"""Ending on SIGINT or SIGTERM without being cut in two."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event


@contextmanager
def stop_requested() -> Iterator[Event]:
    """Turn SIGINT and SIGTERM into an event while the block runs.

    The default handlers raise in the middle of a write, and rclpy's shut the context down under the feet of a callback
    that publishes.
    """
    stop = Event()
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
