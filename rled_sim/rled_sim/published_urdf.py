"""The URDF text that is published for a robot: what any tool needs to draw it from the topics alone.

The files that simulators come with name meshes beside themselves as if their folder were a package, stand nowhere, and
leave it to the simulator how wide the gripper is open. Here

- meshes are in this package, ``package://rled_sim/robots/...``, where ``setup.py`` installs them;
- a link ``world``, the frame of all poses, carries the robot, so that the tree of ``robot_state_publisher`` has it;
- joints that ``joint_states`` does not have are fixed where the simulation holds them.
"""

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rled_sim.joints import REVOLUTE, Joint, joint_of, rotation_about

ROOT = "world"
SCHEME = "package://"
OWN = f"{SCHEME}rled_sim/robots/"
"""Meshes of the robots here: what follows is the folder of the robot's URDF and the path in it."""


def publishable(urdf: Path, moved: Sequence[str], held: Mapping[str, float]) -> str:
    """The description to publish of a robot.

    Args:
        urdf: its file.
        moved: joints that ``joint_states`` has.
        held: where other joints are held (rad or m); those not named are at 0.
    """
    robot = ElementTree.fromstring(urdf.read_text(encoding="utf-8"))
    for mesh in robot.iter("mesh"):
        mesh.set("filename", _uri(mesh.get("filename", ""), urdf.parent))
    for element in robot.findall("joint"):
        if element.get("type") != "fixed" and element.get("name") not in moved:
            _fix(element, held.get(element.get("name", ""), 0.0))
    _stand_on_world(robot)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def mesh_path(name: str, folders: Sequence[Path]) -> Path:
    """Where a mesh that a URDF names lies on this machine; where it would, if it is not there.

    Args:
        name: a path, ``file://`` or ``package://``: looked up in ROS workspaces, then beside known robots.
        folders: those of the known robots' URDFs.
    """
    path = name.removeprefix("file://")
    if not path.startswith(SCHEME):
        return Path(path)
    shares = [Path(each, "share") for each in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if each]
    candidates = [share / path.removeprefix(SCHEME) for share in shares]
    if path.startswith(OWN):
        candidates += [folder.parent / path.removeprefix(OWN) for folder in folders]
    candidates += [folder / path.removeprefix(SCHEME) for folder in folders]
    return next((each for each in candidates if each.is_file()), Path(path.removeprefix(SCHEME)))


def _uri(name: str, folder: Path) -> str:
    path = name.removeprefix(SCHEME)
    return f"{OWN}{folder.name}/{path}" if (folder / path).is_file() else name


def _fix(element: ElementTree.Element, value: float) -> None:
    """Make a joint fixed at a position (rad or m)."""
    joint = joint_of(element)
    rotation, translation = _displaced(joint, value)
    for part in element.findall("*"):
        if part.tag not in ("parent", "child"):
            element.remove(part)
    element.set("type", "fixed")
    ElementTree.SubElement(element, "origin", xyz=_words(translation), rpy=_words(_angles(rotation)))


def _displaced(joint: Joint, value: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if joint.kind in REVOLUTE:
        return joint.rotation @ rotation_about(joint.axis, value), joint.translation
    return joint.rotation, joint.translation + joint.rotation @ (value * joint.axis)


def _angles(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Roll, pitch and yaw (rad) of Rz(yaw) Ry(pitch) Rx(roll), shape (3,)."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-9:  # only roll and yaw together are known
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll, yaw = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([roll, pitch, yaw])


def _words(values: NDArray[np.float64]) -> str:
    return " ".join(f"{value + 0.0:.12g}" for value in values)


def _stand_on_world(robot: ElementTree.Element) -> None:
    children = {child.get("link") for child in robot.iterfind("joint/child")}
    links = [link.get("name", "") for link in robot.findall("link")]
    root = next(name for name in links if name not in children)
    if ROOT in links:
        return
    joint = ElementTree.Element("joint", name=f"{ROOT}_to_{root}", type="fixed")
    ElementTree.SubElement(joint, "parent", link=ROOT)
    ElementTree.SubElement(joint, "child", link=root)
    ElementTree.SubElement(joint, "origin", xyz="0 0 0", rpy="0 0 0")
    robot.insert(0, joint)
    robot.insert(0, ElementTree.Element("link", name=ROOT))
