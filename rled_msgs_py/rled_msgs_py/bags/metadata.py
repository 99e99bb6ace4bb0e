"""``metadata.yaml`` of a bag folder, version 9, as rosbag2 of Jazzy writes it."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from rled_msgs_py.bags.error import BagError, Damage, ForeignBag, remedy
from rled_msgs_py.bags.storage import BagTopic
from rled_msgs_py.errors import ContractError, command
from rled_msgs_py.files import whole_file
from rled_msgs_py.topics import Qos
from rled_msgs_py.untrusted import read_text, read_yaml

FILE_NAME = "metadata.yaml"
ROOT = "rosbag2_bagfile_information"
STORAGES = ("mcap", "sqlite3")
MAX_QOS = 64 << 10
"""Characters of the quality of service of a channel; that of one publisher takes 400."""
NO_TIME = 2**63 - 1
"""Starting time of a bag without messages."""

DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

FOREVER = {"sec": 9223372036, "nsec": 854775807}


class FileSummary(NamedTuple):
    """What one file of a bag holds.

    Attributes:
        name: file name.
        first: minimum log time (ns).
        last: maximum log time (ns).
        counts: messages of each topic.
    """

    name: str
    first: int
    last: int
    counts: Mapping[BagTopic, int]


class Contents(NamedTuple):
    """What a reader takes from ``metadata.yaml``."""

    files: list[str]
    message_count: int
    custom: dict[str, str]


def qos_profiles(qos: Qos) -> str:
    """Offered quality of service, as the YAML text that a channel carries."""
    profile = {
        "history": "keep_last",
        "depth": qos.depth,
        "reliability": qos.reliability,
        "durability": qos.durability,
        "deadline": dict(FOREVER),
        "lifespan": dict(FOREVER),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(FOREVER),
        "avoid_ros_namespace_conventions": False,
    }
    return _dump([profile]).strip()


def information(files: Iterable[FileSummary], custom: Mapping[str, str]) -> dict[str, Any]:
    """The content of ``metadata.yaml`` below its root."""
    files = list(files)
    counts: dict[BagTopic, int] = {}
    for file in files:
        for topic, count in file.counts.items():
            counts[topic] = counts.get(topic, 0) + count
    first, last = min((file.first for file in files), default=NO_TIME), max((file.last for file in files), default=0)
    return {
        "version": 9,
        "storage_identifier": "mcap",
        **_extent(first, last),
        "message_count": sum(counts.values()),
        "topics_with_message_count": [_topic(topic, count) for topic, count in counts.items()],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {"path": file.name, **_extent(file.first, file.last), "message_count": sum(file.counts.values())}
            for file in files
        ],
        "custom_data": dict(custom) or None,
        "ros_distro": "jazzy",
    }


def serialized(files: Iterable[FileSummary], custom: Mapping[str, str]) -> str:
    """The text that rosbag2 keeps inside an MCAP file too."""
    return _dump(information(files, custom))


def write_metadata(folder: Path, files: Iterable[FileSummary], custom: Mapping[str, str]) -> None:
    """Write ``metadata.yaml``, whole."""
    with whole_file(folder / FILE_NAME) as temporary:
        temporary.write_text(_dump({ROOT: information(files, custom)}), encoding="utf-8")


def read_metadata(folder: Path) -> Contents:
    """Read ``metadata.yaml`` of any version.

    Raises:
        ForeignBag: another storage, or compressed in a way that is not read.
        BagError: missing, unreadable, or damaged.
    """
    path = folder / FILE_NAME
    try:
        found = read_yaml(read_text(path, str(path)), str(path))[ROOT]
        _require_readable(folder, found)
        return _contents(found)
    except FileNotFoundError:
        what = f"{folder} has no {FILE_NAME}, so its recorder has not ended in order"
        raise BagError(what, "a finished bag", remedy(folder)) from None
    except OSError as error:
        raise BagError(f"{path} cannot be read: {error.strerror}") from None
    except (ContractError, LookupError, TypeError, ValueError, AttributeError):
        raise BagError(f"{path} is damaged", "metadata of a rosbag2 recording", remedy(folder)) from None


def _contents(found: Mapping[str, Any]) -> Contents:
    paths, count = found["relative_file_paths"], found["message_count"]
    files = [Path(_text(path)).name for path in paths]  # old versions wrote paths from the folder above
    if not isinstance(paths, list) or len(set(files)) < len(files) or any("\0" in name for name in files):
        raise ValueError("relative_file_paths are not files of the folder")
    if type(count) is not int or not 0 <= count < NO_TIME:
        raise ValueError("message_count is no count")
    return Contents(files, count, _custom(found))


def custom_of(texts: Sequence[str]) -> dict[str, str]:
    """The user's metadata, of the copies of them that an MCAP file keeps.

    Raises:
        Damage: a copy cannot be read, or two differ.
    """
    try:
        copies = [_custom(read_yaml(text, "the metadata record") or {}) for text in texts]
    except (ContractError, AttributeError, TypeError, ValueError):
        raise Damage("its metadata record is no YAML of a rosbag2 recording") from None
    if any(copy != copies[0] for copy in copies):
        raise Damage("the copies of its metadata differ")
    return copies[0] if copies else {}


def offered(qos: str) -> list[dict[str, Any]]:
    """The profiles of a channel's text; none where it is something else, which is no reason to refuse messages."""
    try:
        found = read_yaml(qos, "the quality of service") if len(qos) <= MAX_QOS else None
    except ContractError:
        found = None
    return found if isinstance(found, list) and all(isinstance(each, dict) for each in found) else []


def _custom(found: Mapping[str, Any]) -> dict[str, str]:
    return {_text(key): _text(value) for key, value in (found.get("custom_data") or {}).items()}


def _text(value: Any) -> str:
    """A scalar as text; ``str`` refuses integers that are too long with a ValueError."""
    if not isinstance(value, str | int | float | None | date):
        raise TypeError(f"{type(value)} is no text")
    return str(value)


def _require_readable(folder: Path, found: Mapping[str, Any]) -> None:
    storage, mode = (_text(found.get(name, "")) for name in ("storage_identifier", "compression_mode"))
    if storage not in STORAGES:
        raise ForeignBag(f"{folder} has the storage_identifier '{storage}'", ", ".join(STORAGES))
    if mode.lower() not in ("", "none", "storage"):
        target = folder.resolve().with_name(f"{folder.resolve().name}_converted")
        convert = command("rosbags-convert", "--src", folder, "--dst", target, "--dst-storage", "mcap")
        raise ForeignBag(f"{folder} has the compression_mode '{mode}'", "none, storage", f"convert it with: {convert}")


def _extent(first: int, last: int) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": max(last - first, 0)},
        "starting_time": {"nanoseconds_since_epoch": first},
    }


def _topic(topic: BagTopic, count: int) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type,
            "serialization_format": topic.encoding,
            "offered_qos_profiles": offered(topic.qos),
            "type_description_hash": topic.hash,
        },
        "message_count": count,
    }


def _dump(content: Any) -> str:
    return str(yaml.dump(content, Dumper=DUMPER, sort_keys=False, width=1 << 20))
