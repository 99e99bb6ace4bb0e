"""Small bags, and everything that is read of one."""

import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from mcap.stream_reader import StreamReader
from rled_msgs_py.bags import Bag, review
from rled_msgs_py.errors import RledError
from rled_msgs_py.topics import RECORDED, TASK_STATUS

from ..rled_msgs_py.samples import write_bag

JOINTS = [topic for topic in RECORDED if topic.type.endswith("JointState")]
POSES = [topic for topic in RECORDED if topic.type.endswith("PoseStamped")]


@lru_cache
def files() -> dict[str, bytes]:
    """The files of two small bags, one with metadata of its user."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, options in {"bag": {}, "noted": {"metadata": {"seed": "7"}}}.items():
            path = write_bag(Path(folder) / "bag", ticks=6, flush_every=2, **options)
            found[name] = (path / "bag_0.mcap").read_bytes()
            found[f"{name}.yaml"] = (path / "metadata.yaml").read_bytes()
            for each in path.iterdir():
                each.unlink()
            path.rmdir()
    return found


def lay(folder: Path, mcap: bytes, metadata: bytes | None = None) -> Path:
    """A bag of one file in a folder; unfinished without metadata."""
    path = folder / "bag"
    path.mkdir()
    (path / "bag_0.mcap").write_bytes(mcap)
    if metadata is not None:
        (path / "metadata.yaml").write_bytes(metadata)
    return path


def read_everything(bag: Bag) -> None:
    """Each part of a bag, whatever becomes of the others; a part that is refused is passed over."""
    for read in _readers(bag):
        with suppress(RledError):
            read()


def _readers(bag: Bag) -> Iterator[Callable[[], Any]]:
    yield lambda: bag.task
    yield lambda: bag.robot_description
    yield lambda: [bag.name_of(message) for message in bag.messages()]
    yield lambda: list(bag.ticks())
    yield lambda: review(bag)
    yield lambda: list(bag.records(TASK_STATUS))
    for topic in JOINTS:
        yield lambda topic=topic: bag.joints(topic)
    for topic in POSES:
        yield lambda topic=topic: bag.poses(topic)


def messages(path: Path) -> Counter[tuple[str, bytes]]:
    """What the mcap library reads of a file, up to where it gives up."""
    found, channels = Counter[tuple[str, bytes]](), dict[int, str]()
    with path.open("rb") as file, suppress(Exception):
        for record in StreamReader(file, validate_crcs=True).records:
            kind = type(record).__name__
            if kind == "Channel":
                channels[record.id] = record.topic
            elif kind == "Message":
                found[channels[record.channel_id], record.data] += 1
    return found
