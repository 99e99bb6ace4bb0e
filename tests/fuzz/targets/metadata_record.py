"""The copy of the metadata inside an MCAP file: the text that rosbag2 keeps there."""

from contextlib import suppress
from pathlib import Path
from random import Random

import yaml
from mcap.records import Metadata
from rled_msgs_py.bags import Bag, repair
from rled_msgs_py.bags.mcap_records import packed
from rled_msgs_py.errors import RledError

from ..bags import files, lay
from ..mutators import mcap
from ..mutators.values import yaml_text as mutate

__all__ = ["mutate", "read", "seeds"]


def seeds() -> list[bytes]:
    return [yaml.dump(yaml.safe_load(files()["noted.yaml"])["rosbag2_bagfile_information"]).encode()]


def read(data: bytes, folder: Path) -> None:
    record = packed(Metadata("rosbag2", {"serialized_metadata": data.decode(errors="replace")}))
    part = mcap.Part(mcap.METADATA, record[mcap.HEAD.size :])
    whole = mcap.parsed(files()["bag"])
    bare = folder / "bare.mcap"
    bare.write_bytes(mcap.framed([*whole[:1], part, *whole[1:]], Random(0)))
    with suppress(RledError):
        Bag(bare)
    repair(lay(folder, mcap.framed([*whole[:1], part, *whole[1:-2]], Random(0))))
