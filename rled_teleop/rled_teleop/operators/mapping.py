"""The recording mapping g_rec of Eq. 2.1: from a device that a person moves to the robot, joint by joint."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import JointSample
from rled_msgs_py.untrusted import read_text, read_yaml

Vector = NDArray[np.float64]

DEFAULTS = {"scale": 1.0, "offset": 0.0}
FORM = "{joint: {name: device_joint, scale: 1.0, offset: 0.0}, ...}, or a file of that ending in .yaml"


class JointMap(NamedTuple):
    """How one joint of the robot follows the device: angle = scale * device angle + offset.

    Attributes:
        name: joint of the device.
        scale: robot's angle per device's angle (1).
        offset: robot's angle (rad) at the device's zero.
    """

    name: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class RecordingMapping:
    """g_rec: what the robot's joints are when the device's are so.

    Attributes:
        joints: of the robot, in the order of its joint vector.
        maps: one for each of them.
    """

    joints: tuple[str, ...]
    maps: tuple[JointMap, ...]

    @staticmethod
    def from_yaml(text: str, joints: tuple[str, ...]) -> "RecordingMapping":
        """Read ``joint: {name: ..., scale: ..., offset: ...}`` for each joint of the robot, from a text or a file.

        What is left out keeps its default: the same name, scale 1, offset 0. An empty text maps each joint to itself.

        Raises:
            RledError: no such file, no YAML, a joint that the robot has not, or a value that is no number.
        """
        entries = _parse(text)
        unknown = sorted(str(each) for each in set(entries) - set(joints))
        if unknown:
            raise RledError(f"the mapping names {', '.join(unknown):.200}", ", ".join(joints))
        return RecordingMapping(joints, tuple(_joint_map(joint, entries.get(joint, {})) for joint in joints))

    @property
    def device_joints(self) -> tuple[str, ...]:
        """Joints of the device that are used, each once."""
        return tuple(dict.fromkeys(each.name for each in self.maps))

    def robot_joints(self, device: JointSample) -> Vector:
        """Joint angles of the robot (rad), shape (n,), for a sample of the device.

        Raises:
            RledError: the device lacks a joint, or is where no robot can follow.
        """
        places = {name: place for place, name in enumerate(device.names)}
        missing = [each.name for each in self.maps if each.name not in places]
        if missing:
            raise RledError(
                f"the device has no joint {', '.join(missing)}", ", ".join(device.names), "declare a mapping"
            )
        angles = device.position[[places[each.name] for each in self.maps]]  # (n,)
        with np.errstate(over="ignore"):  # asked about below
            mapped: Vector = np.array([each.scale for each in self.maps]) * angles + [each.offset for each in self.maps]
        if not np.isfinite(mapped).all():
            place = int(np.flatnonzero(~np.isfinite(mapped))[0])
            what = f"the device is at {angles[place]} with its joint {self.maps[place].name}"
            raise RledError(what, "angles whose image is finite")
        return mapped


def _parse(text: str) -> dict[str, Any]:
    what = "the mapping"
    if text.endswith((".yaml", ".yml")):
        what = f"the mapping {text}"
        try:
            text = read_text(Path(text), what)
        except (OSError, ValueError) as error:
            raise RledError(f"{what} cannot be read: {getattr(error, 'strerror', error)}") from None
    entries = read_yaml(text, what)
    if entries is None:
        return {}
    if not isinstance(entries, dict):
        raise RledError(f"{what} is no YAML map", FORM)
    return entries


def _joint_map(joint: str, entry: Any) -> JointMap:
    if not isinstance(entry, Mapping) or not set(entry) <= set(JointMap._fields):
        raise RledError(f"the mapping of {joint} is {entry!s:.80}", "name, scale, offset")
    name = entry.get("name", joint)
    if not isinstance(name, str):
        raise RledError(f"the mapping of {joint} has the name {name!s:.80}", "a text")
    return JointMap(name, *(_number(joint, each, entry.get(each, default)) for each, default in DEFAULTS.items()))


def _number(joint: str, what: str, value: Any) -> float:
    try:
        number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else np.nan
    except OverflowError:
        number = np.nan
    if not np.isfinite(number):
        raise RledError(f"the mapping of {joint} has {what} {value!s:.80}", "a finite number")
    return number
