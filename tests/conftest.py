"""Every test file runs in a ROS graph of its own, apart from any other graph on this machine."""

import errno
import os
import random
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import pytest
from hypothesis import settings

DOMAINS = range(1, 102)  # 0 is everybody's default; above 101 the ports meet Linux's ephemeral ones

os.environ["MPLBACKEND"] = "Agg"
settings.register_profile("rled", deadline=None, derandomize=True)
settings.load_profile("rled")


def _taken(bind: socket.socket, address: str | tuple[str, int]) -> bool:
    try:
        bind.bind(address)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        return True
    return False


def _has_participant(domain: int) -> bool:
    # RTPS 2.3, 9.6.1.1: the first participant of a domain on a host listens on this UDP port
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        return _taken(probe, ("0.0.0.0", 7400 + 250 * domain + 10))


@contextmanager
def free_domain() -> Iterator[int]:
    """Hold a domain id that no other test run and no running participant has.

    The lock is an abstract Unix socket: like DDS it ends at the network namespace, and it goes when its process dies.
    """
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        with ExitStack() as stack:
            lock = stack.enter_context(closing(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)))
            if _taken(lock, f"\0rled-ros-domain-{domain}") or _has_participant(domain):
                continue
            yield domain
            return
    pytest.fail("all ROS domains from 1 to 101 are in use on this machine")


@pytest.fixture(scope="module", autouse=True)
def ros_domain() -> Iterator[int]:
    """The domain id of this test file, set in the environment for the nodes and processes that it starts."""
    with free_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        patch.delenv("ROS_STATIC_PEERS", raising=False)
        patch.delenv("ROS_DISCOVERY_SERVER", raising=False)
        yield domain
