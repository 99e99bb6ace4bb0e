"""A node under siege: hostile messages and requests for it, while the robot beside it is watched.

``RLED_HOSTILE`` says how many are sent of each kind; ``make hostile`` sends more than 30,000 in all.
"""

import os
import struct
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from rclpy.node import NodeNameNonExistentError
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from rled_msgs_py.bags.writer import absolute
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.messages import NANOSECONDS, decode
from rled_msgs_py.records import Text
from rled_msgs_py.ros.convert import qos_profile, to_msg
from rled_msgs_py.ros.liveliness import offer_liveliness
from rled_msgs_py.tick import STATE_TOPICS
from rled_msgs_py.topics import JOINT_DELTA, ROBOT_DESCRIPTION, TASK_DESCRIPTION, Topic
from rled_sim.commands import Refused, displacement

from .hostile import attacks
from .plant import DEEP, Peer, Plant
from .valid_messages import CLASSES, PLANAR, STAMP, VALID

COUNT = int(os.environ.get("RLED_HOSTILE", "25"))
GROWTH = 2.0
"""Memory that may come on top between the first fifth of the messages and the last (MB): allocators breathe."""
DISCOVERY_TIMEOUT = 10.0
"""Seconds that the graph is given to know a node."""
PLACE = slice(4, 12)
"""Where a stamp lies in a serialized message."""

hostility = settings(
    max_examples=COUNT,
    phases=[Phase.generate],  # a node that is gone cannot be asked again
    suppress_health_check=list(HealthCheck),
)

Volley = list[tuple[Topic, Any]]
"""Messages that are sent together, each for its topic."""


def volleys(topics: Iterable[Topic]) -> dict[str, st.SearchStrategy[tuple[int, Volley]]]:
    """Attacks on topics, by name, each with how much later than the newest tick its stamps are (ns).

    Where states are listened to, there are attacks on whole ticks too, of which one message is not what it should be.
    """
    later = st.sampled_from([0, 1, 20_000_000, -20_000_000, 10**12])
    listened = list(topics)
    found = {topic.name: _attacks_on(topic).map(lambda each: [each]) for topic in listened}
    if set(STATE_TOPICS) <= set(listened):
        tick: Volley = [(topic, VALID[topic]) for topic in STATE_TOPICS]
        changed = st.sampled_from(STATE_TOPICS).flatmap(_attacks_on)
        found["whole ticks"] = changed.map(lambda other: [*(each for each in tick if each[0] != other[0]), other])
    return {name: st.tuples(later, volley) for name, volley in found.items()}


def _attacks_on(topic: Topic) -> st.SearchStrategy[tuple[Topic, Any]]:
    return attacks(VALID[topic]).map(lambda message: (topic, message))


def besiege(peer: Peer, strategy: st.SearchStrategy[Any], send: Callable[[Any], object]) -> int:
    """Send what a strategy draws; see that it does the node and the robot no harm. How many were sent."""
    sent, since, memory, witness = [0], len(peer.plant.ticks) - 1, [], Witness(peer.plant)

    @hostility
    @given(strategy)
    def attack(message: Any) -> None:
        send(message)
        sent[0] += 1
        memory.append(peer.resident())
        assert peer.child.exit_code is None, list(peer.child.last_lines)

    while sent[0] < COUNT:  # where there are but few different ones, again
        attack()
    assert peer.plant.outside_limits(since) == []
    assert witness.outside_limits() == []
    assert memory[-1] - memory[len(memory) // 5] < GROWTH
    witness.leave()
    return sent[0]


class Rogue:
    """A second publisher of anything on any topic; a context manager, which leaves the graph when its block ends."""

    def __init__(self, peer: Peer) -> None:
        self._peer, self._plant = peer, peer.plant
        self._outputs: dict[Topic, Publisher] = {}

    def __enter__(self) -> "Rogue":
        return self

    def __exit__(self, *_: object) -> None:
        for output in self._outputs.values():
            self._plant.node.destroy_publisher(output)

    def fire(self, drawn: tuple[int, Volley]) -> None:
        """Send a volley; where it says ``STAMP``, it is as much later than the newest tick as was drawn."""
        later, volley = drawn
        stamp = max(0, self._plant.tick.stamp + later)
        for topic, message in volley:
            self.publish(topic, message, stamp)
        self._peer.ping()  # as a pause, or a queue keeps the last only

    def publish(self, topic: Topic, message: Any, stamp: int = STAMP) -> None:
        """Send one message, or bytes."""
        data = stamped(message if isinstance(message, bytes) else serialize_message(message), stamp)
        self._plant.forged.add(data)
        with suppress(RuntimeError):  # the middleware sends no more bytes than a type can have
            self._output(topic).publish(data)

    def describe(self) -> None:
        """Say what is true of robot and task, as a simulation does when it is started again."""
        for topic, text in ((ROBOT_DESCRIPTION, PLANAR.description), (TASK_DESCRIPTION, self._plant.task.to_json())):
            self.publish(topic, to_msg(Text(text)))

    def _output(self, topic: Topic) -> Publisher:
        if topic not in self._outputs:
            node = self._plant.node
            if topic in (ROBOT_DESCRIPTION, TASK_DESCRIPTION):  # which some listen to for signs of life only
                output = offer_liveliness(node, topic)
            else:
                output = node.create_publisher(CLASSES[topic.type], topic.name, qos_profile(topic.qos))
            self._outputs[topic] = output
            name = output.topic_name
            self._plant.wait(lambda: output.get_subscription_count() >= node.count_subscribers(name) > 0, topic.name)
        return self._outputs[topic]


def stamped(data: bytes, stamp: int) -> bytes:
    """A message with another stamp in the place of ``STAMP``."""
    if data[PLACE] != struct.pack("<iI", 0, STAMP):
        return data
    return data[: PLACE.start] + struct.pack("<iI", *divmod(stamp, NANOSECONDS)) + data[PLACE.stop :]


class Witness:
    """Hears every command that is given on ``joint_delta``, but for those that are forged."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._heard: list[bytes] = []
        qos = qos_profile(replace(JOINT_DELTA.qos, depth=DEEP))
        self._reader = plant.node.create_subscription(
            CLASSES[JOINT_DELTA.type], JOINT_DELTA.name, self._heard.append, qos, raw=True
        )

    def commands(self) -> int:
        """How many there were."""
        return len(self._heard)

    def outside_limits(self) -> list[str]:
        """Commands that cannot be read, of other joints, or beyond Δq_max."""
        found = []
        for data in self._heard:
            if data in self._plant.forged:
                continue
            try:
                displacement(decode(JOINT_DELTA, data), self._plant.task)  # type: ignore[arg-type]
            except (ContractError, Refused) as error:
                found.append(str(error))
        return found

    def leave(self) -> None:
        """Hear no more."""
        self._plant.node.destroy_subscription(self._reader)


def moves(plant: Plant, since: int) -> bool:
    """Whether the robot has moved since a tick."""
    return len({tick.joints.position.tobytes() for tick in plant.ticks[since:]}) > 3


def require_all(peer: Peer, topics: Iterable[Topic], services: Iterable[str]) -> None:
    """See that a node has no topic and no service that nobody attacks."""
    wanted = {absolute(topic.name) for topic in topics}, set(services)
    with suppress(RledError):
        peer.plant.wait(lambda: _names_of(peer) == wanted, "the graph to know it", DISCOVERY_TIMEOUT)
    assert _names_of(peer) == wanted


def _names_of(peer: Peer) -> tuple[set[str], set[str]]:
    """Topics that a node listens to and services that it offers, as the graph knows them."""
    node = peer.plant.node
    try:
        topics = node.get_subscriber_names_and_types_by_node(peer.name, "/")
        services = node.get_service_names_and_types_by_node(peer.name, "/")
    except NodeNameNonExistentError:
        return set(), set()
    return {name for name, _ in topics}, {name.removeprefix(f"/{peer.name}/") for name, _ in services}
