"""Records to CDR bytes and back, without ROS: message classes, definitions and hashes of ROS 2 Jazzy."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import FROM_MSG, TO_MSG, MessageTypes
from rled_msgs_py.records import Record
from rled_msgs_py.topics import Topic

PACKAGES = {
    "Time": "builtin_interfaces",
    "Header": "std_msgs",
    "String": "std_msgs",
    "JointState": "sensor_msgs",
    "Point": "geometry_msgs",
    "Quaternion": "geometry_msgs",
    "Pose": "geometry_msgs",
    "PoseStamped": "geometry_msgs",
    "KeyValue": "diagnostic_msgs",
    "DiagnosticStatus": "diagnostic_msgs",
    "DiagnosticArray": "diagnostic_msgs",
}


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


@cache
def _message_types() -> MessageTypes:
    classes = {name: _store().types[f"{package}/msg/{name}"] for name, package in PACKAGES.items()}
    return MessageTypes(**classes, array=np.ascontiguousarray, octet=int)


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


def encode(topic: Topic, record: Record) -> bytes:
    """Serialize a record as the topic's message.

    Raises:
        ContractError: the record is of another kind than the topic.
    """
    message = TO_MSG[type(record)](record, _message_types())
    if message.__msgtype__ != topic.type:
        raise ContractError(f"a {type(record).__name__} for {topic.name}", f"a record of {topic.type}")
    return bytes(_store().serialize_cdr(message, topic.type))


def decode(topic: Topic, data: bytes) -> Record:
    """Read a record from its serialized message.

    Bytes after the message are let pass: rclpy's ``serialize_message`` leaves some there.

    Raises:
        ContractError: bytes that are no such message, a wrong size, bad names, NaN or infinity, or a topic of which
            there are no records.
    """
    if topic.name not in FROM_MSG:
        raise ContractError(f"{topic.name} has no records", ", ".join(FROM_MSG))
    return FROM_MSG[topic.name](_message(topic.type, data))


def _message(type_name: str, data: bytes) -> Any:
    if data[:2] not in (b"\x00\x00", b"\x00\x01"):
        raise ContractError(f"a message in the encoding '{data[:2].hex()}'", "plain CDR (0000 or 0001)")
    known = _store().get_msgdef(type_name)
    read = known.deserialize_cdr_le if data[1] else known.deserialize_cdr_be
    try:
        message, _ = read(data[4:], 0, known.cls, _store())
    except Exception as error:  # generated code raises whatever broken bytes lead it to
        raise ContractError(f"{len(data)} bytes that are no {type_name} ({error})") from None
    return message
