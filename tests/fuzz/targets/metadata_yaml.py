"""``metadata.yaml`` beside a sound file."""

from pathlib import Path

from rled_msgs_py.bags import Bag
from rled_msgs_py.bags.metadata import read_metadata

from ..bags import files, lay
from ..mutators.values import yaml_text as mutate


def seeds() -> list[bytes]:
    return [files()["bag.yaml"], files()["noted.yaml"]]


def read(data: bytes, folder: Path) -> None:
    path = lay(folder, files()["noted"], data)
    read_metadata(path)
    assert Bag(path).message_count > 0


__all__ = ["mutate", "read", "seeds"]
