"""A bare MCAP file: opened, and everything in it read."""

from pathlib import Path

from rled_msgs_py.bags import Bag

from ..bags import files, read_everything
from ..mutators.mcap import mutate as mutate


def seeds() -> list[bytes]:
    return [files()["bag"], files()["noted"]]


def read(data: bytes, folder: Path) -> None:
    path = folder / "bag.mcap"
    path.write_bytes(data)
    read_everything(Bag(path))
