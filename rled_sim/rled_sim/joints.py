"""What kinematics needs of a URDF: the joints from the root to a link, their frames and limits."""

import math
import xml.etree.ElementTree as ElementTree
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError

REVOLUTE = ("revolute", "continuous")
MAX_VALUE = 1e6
"""Metres or radians that no robot has: what is computed of them stays finite."""


class Joint(NamedTuple):
    """One joint of a URDF.

    Attributes:
        name: name of the joint.
        kind: URDF type (``revolute``, ``fixed``, ...).
        parent: link that carries the joint.
        child: link that the joint moves.
        rotation: of the joint's frame in the parent's, shape (3, 3).
        translation: of the joint's frame in the parent's (m), shape (3,).
        axis: unit vector in the joint's frame, shape (3,).
        lower: smallest angle (rad).
        upper: largest angle (rad).
        velocity: largest rate (rad/s).
        effort: largest torque (N m).
    """

    name: str
    kind: str
    parent: str
    child: str
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    axis: NDArray[np.float64]
    lower: float
    upper: float
    velocity: float
    effort: float


def joints_to(text: str, tip_link: str) -> list[Joint]:
    """The joints of the path from the root to ``tip_link``, in that order.

    Raises:
        RledError: no XML, no such link, or a number that cannot be read.
    """
    by_child = _joints_by_child(text)
    if tip_link not in by_child:
        raise RledError(f"the URDF moves no link '{tip_link}'", ", ".join(by_child), "name one of its links")
    path: list[Joint] = []
    link = tip_link
    while link in by_child:
        joint = by_child.pop(link)
        path.append(joint)
        link = joint.parent
    return path[::-1]


def rotation_about(axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Rotation matrix by ``angle`` (rad) about a unit vector (Rodrigues), shape (3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: NDArray[np.float64] = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return rotation


def _joints_by_child(text: str) -> dict[str, Joint]:
    try:
        joints = [joint_of(element) for element in ElementTree.fromstring(text).findall("joint")]
    except (ElementTree.ParseError, ValueError, AttributeError) as error:
        raise RledError(f"the robot description is no URDF ({error})", "URDF text") from None
    return {joint.child: joint for joint in joints}


def joint_of(element: ElementTree.Element) -> Joint:
    """A joint from its element.

    Raises:
        ValueError: a number that cannot be read.
    """
    origin, axis, limit = (_attributes(element, tag) for tag in ("origin", "axis", "limit"))
    direction = _numbers(axis.get("xyz", "1 0 0"))
    return Joint(
        name=element.attrib.get("name", ""),
        kind=element.attrib.get("type", ""),
        parent=_attributes(element, "parent").get("link", ""),
        child=_attributes(element, "child").get("link", ""),
        rotation=_rotation(*_numbers(origin.get("rpy", "0 0 0"))),
        translation=_numbers(origin.get("xyz", "0 0 0")),
        axis=direction / (float(np.linalg.norm(direction)) or 1.0),
        lower=float(limit.get("lower", "-inf")),
        upper=float(limit.get("upper", "inf")),
        velocity=float(limit.get("velocity", "inf")),
        effort=float(limit.get("effort", "inf")),
    )


def _attributes(element: ElementTree.Element, tag: str) -> dict[str, str]:
    found = element.find(tag)
    return {} if found is None else found.attrib


def _numbers(text: str) -> NDArray[np.float64]:
    values = np.array([float(word) for word in text.split()])
    if values.shape != (3,) or not (np.abs(values) < MAX_VALUE).all():
        raise ValueError(f"'{text}' is not three numbers below {MAX_VALUE:g}")
    return values


def _rotation(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """Rz(yaw) Ry(pitch) Rx(roll), URDF's fixed-axis convention."""
    x, y, z = np.eye(3)
    return rotation_about(z, yaw) @ rotation_about(y, pitch) @ rotation_about(x, roll)
