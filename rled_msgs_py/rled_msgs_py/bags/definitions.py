"""What a bag says of its messages, without ROS: definitions and hashes of ROS 2 Jazzy."""

from functools import cache
from typing import NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore


class Definition(NamedTuple):
    """A message type as a bag describes it.

    Attributes:
        text: the definition and those that it needs, in the encoding ``ros2msg``.
        hash: REP 2016 hash, ``RIHS01_...``.
    """

    text: str
    hash: str


@cache
def _store() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def is_known(type_name: str) -> bool:
    """Whether ROS 2 Jazzy defines a message type."""
    return type_name in _store().fielddefs


@cache
def definition(type_name: str) -> Definition:
    """Definition of a message type of Jazzy's common interfaces."""
    text, _ = _store().generate_msgdef(type_name, ros_version=2)
    return Definition(text, _store().hash_rihs01(type_name))


@cache
def defines(text: str, type_name: str) -> bool:
    """Whether a ``ros2msg`` text found in a bag has the fields of Jazzy's definition, whatever its comments."""
    try:
        found = get_types_from_msg(text, type_name)
    except Exception:  # the parser raises whatever a broken text leads it to
        return False
    known = _store().fielddefs
    return all(name in known and known[name][1] == fields for name, (_, fields) in found.items())
