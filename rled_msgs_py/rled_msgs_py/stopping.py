"""Ending on SIGINT, SIGTERM or SIGHUP without being cut in two."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event


@contextmanager
def stop_requested() -> Iterator[Event]:
    """Turn SIGINT, SIGTERM and the end of the terminal (SIGHUP) into an event while the block runs.

    The default handlers raise in the middle of a write, and rclpy's shut the context down under the feet of a callback
    that publishes. Behind ``nohup`` the end of the terminal is still nothing.
    """
    stop = Event()
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
