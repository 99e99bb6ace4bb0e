"""The journal of a killed recorder, taken in by a repair of the file that it lies beside."""

from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from rled_msgs_py.bags import BagWriter, repair
from rled_msgs_py.bags.mcap_journal import SUFFIXES
from rled_msgs_py.messages import encode

from ...rled_msgs_py.samples import PERIOD, descriptions, tick
from ..bags import lay, messages
from ..mutators.mcap import mutate as mutate


@lru_cache
def killed() -> tuple[bytes, bytes]:
    """What a killed recorder leaves: its file and its journal."""
    with TemporaryDirectory() as folder, BagWriter(Path(folder) / "bag") as bag:
        for topic, record in [*descriptions(), *tick(0), *tick(1)]:
            bag.write(topic, record)
        bag.flush()
        for topic, record in [*tick(2), *tick(3)]:
            bag.keep(topic, encode(topic, record), 3 * PERIOD)
        file = bag.path / "bag_0.mcap"
        return file.read_bytes(), file.with_name(file.name + SUFFIXES[0]).read_bytes()


def seeds() -> list[bytes]:
    return [killed()[1]]


def read(data: bytes, folder: Path) -> None:
    path = lay(folder, killed()[0])
    file = path / "bag_0.mcap"
    file.with_name(file.name + SUFFIXES[0]).write_bytes(data)
    before = messages(file)
    repair(path)
    assert before <= messages(file), "messages of the file itself are lost"
