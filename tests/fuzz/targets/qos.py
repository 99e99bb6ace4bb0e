"""The quality of service that a bag's channel says it was published with."""

from pathlib import Path

from rled_msgs_py.bags.metadata import FileSummary, serialized
from rled_msgs_py.bags.writer import describe
from rled_msgs_py.topics import JOINT_DELTA, ROBOT_DESCRIPTION
from rled_teleop.recording.bag_messages import quality

from ..mutators.values import yaml_text as mutate

__all__ = ["mutate", "read", "seeds"]


def seeds() -> list[bytes]:
    return [describe(topic).qos.encode() for topic in (JOINT_DELTA, ROBOT_DESCRIPTION)]


def read(data: bytes, _: Path) -> None:
    topic = describe(JOINT_DELTA)._replace(qos=data.decode(errors="replace"))
    found = quality(topic)
    assert 1 <= found.depth <= 2**31, f"a depth of {found.depth}, which no middleware takes"
    serialized([FileSummary("bag_0.mcap", 0, 1, {topic: 1})], {})
