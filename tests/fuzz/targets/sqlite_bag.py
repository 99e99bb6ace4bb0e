"""A bare sqlite3 file of an older recording."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from rled_msgs_py.bags import Bag
from rled_msgs_py.messages import encode
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ...rled_msgs_py.samples import recording
from ..bags import read_everything
from ..mutators.messages import mutate_sqlite as mutate

__all__ = ["mutate", "read", "seeds"]


@lru_cache
def seeds() -> Sequence[bytes]:
    with TemporaryDirectory() as folder:
        store, connections = get_typestore(Stores.ROS2_JAZZY), {}
        with Writer(Path(folder) / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            for number, (topic, record) in enumerate(recording(3)):
                if topic not in connections:
                    connections[topic] = writer.add_connection(f"/{topic.name}", topic.type, typestore=store)
                writer.write(connections[topic], number, encode(topic, record))
        return [(Path(folder) / "bag" / "bag.db3").read_bytes()]


def read(data: bytes, folder: Path) -> None:
    path = folder / "bag.db3"
    path.write_bytes(data)
    read_everything(Bag(path))
