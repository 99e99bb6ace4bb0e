"""Programs of ours in processes of their own."""

import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from rled_msgs_py.processes import program

WAIT_TIMEOUT = 40.0
ENDLESS = ("--targets-per-episode", "0", "--max-steps", "0", "--discovery-wait", "0.2")


@contextmanager
def running(package: str, name: str, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """One of them, ended by SIGINT when the block ends."""
    process = subprocess.Popen([*program(package, name), *arguments], stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=WAIT_TIMEOUT)


@contextmanager
def planar_simulation(mode: str) -> Iterator[None]:
    """A simulated planar robot with an endless task, in ``lockstep`` or ``real_time``."""
    with running("rled_sim", "sim_node", "--robot", "planar", "--mode", mode, *ENDLESS):
        yield
