"""Command ``security_policy``: write down what each node of the running graph may do, as an SROS2 policy.

Each node gets an enclave of its own, named as the node is in the graph: /sim, /left/agent_node. The file is policy
version 0.2.0, from which ``ros2 security generate_artifacts`` makes keys and permissions.
"""

import argparse
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from rclpy.context import Context
from rclpy.node import Node

from rled_msgs_py.errors import RledError, command_line
from rled_msgs_py.files import write_whole
from rled_msgs_py.ros.node import fresh_context

VERSION = "0.2.0"
POLL_PERIOD = 0.2
"""Seconds between two looks at the graph."""


class Rights(NamedTuple):
    """What a node does in the graph: absolute names of topics and services."""

    namespace: str
    node: str
    publish: frozenset[str]
    subscribe: frozenset[str]
    reply: frozenset[str]
    request: frozenset[str]

    @property
    def path(self) -> str:
        """Full name of the node, and of its enclave."""
        return f"{self.namespace.rstrip('/')}/{self.node}"


def observe(observer: Node) -> list[Rights]:
    """What each node is seen to do now; hidden nodes and the observer itself are left out."""

    def names(found: Iterable[tuple[str, list[str]]]) -> frozenset[str]:
        return frozenset(name for name, _ in found)

    return [
        Rights(
            namespace,
            node,
            names(observer.get_publisher_names_and_types_by_node(node, namespace)),
            names(observer.get_subscriber_names_and_types_by_node(node, namespace)),
            names(observer.get_service_names_and_types_by_node(node, namespace)),
            names(observer.get_client_names_and_types_by_node(node, namespace)),
        )
        for node, namespace in sorted(set(observer.get_node_names_and_namespaces()))
        if not node.startswith("_") and node != observer.get_name()
    ]


def watch(context: Context, seconds: float) -> list[Rights]:
    """All that each node is seen to do within a while; one that ends meanwhile stays in the list."""
    observer = Node("security_policy", context=context, start_parameter_services=False)
    seen: dict[str, Rights] = {}
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        time.sleep(POLL_PERIOD)
        for now in observe(observer):
            before = seen.get(now.path, now)
            joined = (one | other for one, other in zip(before[2:], now[2:], strict=True))
            seen[now.path] = Rights(now.namespace, now.node, *joined)
    observer.destroy_node()
    return [seen[path] for path in sorted(seen)]


def policy(graph: Iterable[Rights]) -> str:
    """The policy that allows this and nothing else, as XML."""
    root = Element("policy", version=VERSION)
    enclaves = SubElement(root, "enclaves")
    for rights in graph:
        profiles = SubElement(SubElement(enclaves, "enclave", path=rights.path), "profiles")
        profile = SubElement(profiles, "profile", ns=rights.namespace, node=rights.node)
        for kind, verb in (("topic", "publish"), ("topic", "subscribe"), ("service", "reply"), ("service", "request")):
            if names := sorted(getattr(rights, verb)):
                allowed = SubElement(profile, f"{kind}s", {verb: "ALLOW"})
                for name in names:
                    SubElement(allowed, kind).text = name
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


@command_line
def main() -> None:
    """Watch the graph and write the policy."""
    parser = argparse.ArgumentParser(prog="security_policy", description="Write the running graph's SROS2 policy.")
    parser.add_argument("output", type=Path, help="file to write: policy.xml")
    parser.add_argument("--seconds", type=float, default=5.0, help="how long to watch the graph (5)")
    options = parser.parse_args()
    context = fresh_context()
    try:
        graph = watch(context, options.seconds)
    finally:
        context.try_shutdown()
    if not graph:
        raise RledError("no node was seen", "a running graph in this ROS_DOMAIN_ID", "start all nodes first")
    write_whole(options.output, policy(graph))
    print(f"{options.output}: {', '.join(rights.path for rights in graph)}")


if __name__ == "__main__":
    main()
