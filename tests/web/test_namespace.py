"""A page in a namespace, with all that it starts."""

from collections.abc import Iterator
from contextlib import closing

import pytest

from ..graph.conftest import Observer
from .conftest import serving
from .socket_visitor import SocketVisitor


@pytest.fixture
def left(ros_domain: int) -> Iterator[Observer]:
    with closing(Observer("left")) as observer:
        yield observer


def test_what_the_page_starts_is_in_its_namespace(left):
    options = "--robot", "planar", "--ros-args", "-r", "__ns:=/left"
    with serving(*options) as address, closing(SocketVisitor(address)) as me:
        me.find("y +")
        before = left.wait_ticks(1)[-1].ee.position[1]
        with me.holding("y +"):
            left.wait(lambda: left.ticks[-1].ee.position[1] > before + 0.01, "motion")
        wanted = {("sim", "/left"), ("teleop_web", "/left"), ("web_operator", "/left")}
        left.wait(lambda: wanted <= set(left.node.get_node_names_and_namespaces()), "the nodes to be discovered")
