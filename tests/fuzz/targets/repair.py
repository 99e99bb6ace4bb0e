"""Repair of a bag's folder: never poorer than what the mcap library reads, readable afterwards, or left as it was."""

from pathlib import Path

from rled_msgs_py.bags import BagError, repair
from rled_msgs_py.bags.folder import open_files

from ..bags import files, lay, messages
from ..mutators import mcap

MOST_CLAIMED = 1 << 22


def seeds() -> list[bytes]:
    whole = files()["bag"]
    return [whole, files()["noted"], whole[: len(whole) // 2]]


mutate = mcap.mutate


def read(data: bytes, folder: Path) -> None:
    path = lay(folder, data)
    file = path / "bag_0.mcap"
    before = messages(file) if _is_small(data) else None
    try:
        done = repair(path)
    except BagError:
        assert file.read_bytes() == data, "a bag whose repair is refused was changed"
        raise
    read_of = sum(sum(each.counts.values()) for each in open_files(path)[0])
    assert read_of == done.messages, f"{read_of} messages are read, {done.messages} were said to be there"
    if before is not None and file.read_bytes() != data:
        lost = before - messages(file)
        assert not lost, f"{lost.total()} of {before.total()} messages are lost"


def _is_small(data: bytes) -> bool:
    """Whether the library, which has no bound, can be asked."""
    parts = mcap.parsed(data)
    return all(part.inner is not None or part.code != mcap.CHUNK_CODE for part in parts)
