"""The files of a bag, found from its folder or its one file."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rled_msgs_py.bags.error import BagError, remedy
from rled_msgs_py.bags.mcap_file import McapFile
from rled_msgs_py.bags.metadata import FILE_NAME, read_metadata
from rled_msgs_py.bags.sqlite_file import SqliteFile
from rled_msgs_py.bags.storage import Storage

STORAGES: Mapping[str, Callable[[Path], Storage]] = {".mcap": McapFile, ".db3": SqliteFile}
"""How to open a file, by its suffix."""


def open_files(path: Path) -> tuple[list[Storage], dict[str, str]]:
    """The files of a bag in order, and the metadata its user gave.

    Raises:
        BagError: the bag is missing, unfinished, damaged or foreign.
    """
    if not path.exists():
        raise BagError(f"{path} does not exist", "a rosbag2 folder or an .mcap file", "is the path right?")
    return _open_folder(path) if path.is_dir() else _open_bare(path)


def mcap_files(folder: Path) -> list[Path]:
    """The .mcap files in a folder, in the order of their numbers (``name_2`` before ``name_10``)."""
    return sorted(folder.glob("*.mcap"), key=lambda path: (len(path.name), path.name))


def _open_folder(folder: Path) -> tuple[list[Storage], dict[str, str]]:
    if not (folder / FILE_NAME).exists() and not mcap_files(folder):
        raise BagError(f"{folder} is no bag", "a rosbag2 folder with metadata.yaml and .mcap files")
    contents = read_metadata(folder)
    files = [_open_file(folder / name) for name in contents.files]
    count = sum(sum(file.counts.values()) for file in files)
    if count != contents.message_count:
        what = f"{folder} is damaged: it holds {count} messages, its {FILE_NAME} says {contents.message_count}"
        raise BagError(what, "", remedy(folder))
    # the copy inside the files is under their checksum
    return files, _custom(files) or contents.custom


def _open_bare(path: Path) -> tuple[list[Storage], dict[str, str]]:
    files = [_open_file(path)]
    return files, _custom(files)


def _open_file(path: Path) -> Storage:
    if path.suffix not in STORAGES:
        raise BagError(f"{path} is no bag", f"a rosbag2 folder, or a file {', '.join(STORAGES)}")
    return STORAGES[path.suffix](path)


def _custom(files: Sequence[Storage]) -> dict[str, str]:
    return dict(files[-1].custom) if files else {}
