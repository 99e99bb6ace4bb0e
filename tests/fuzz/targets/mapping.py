"""The mapping from a device's joints to the robot's, as YAML of a user."""

from pathlib import Path

import numpy as np
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import JointSample
from rled_teleop.operators.mapping import RecordingMapping

from ..mutators.values import yaml_text as mutate

__all__ = ["mutate", "read", "seeds"]

JOINTS = ("shoulder", "elbow")
TEXTS = ("", "shoulder: {name: j1, scale: -1.0, offset: 0.5}\nelbow: {name: j2, scale: 2}\n", "elbow:\n  name: j1\n")


def seeds() -> list[bytes]:
    return [text.encode() for text in TEXTS]


def read(data: bytes, folder: Path) -> None:
    path = folder / "mapping.yaml"
    path.write_bytes(data)
    try:
        of_text = RecordingMapping.from_yaml(data.decode(), JOINTS) if not data.endswith((b".yaml", b".yml")) else None
    except (UnicodeDecodeError, RledError):
        of_text = None
    found = RecordingMapping.from_yaml(str(path), JOINTS)
    assert of_text is None or of_text == found, "another mapping from a file than from the same text"
    angles = found.robot_joints(JointSample(0, ("j1", "j2", *JOINTS), np.array([0.1, 0.2, 0.3, 0.4]), np.zeros(4)))
    assert angles.shape == (2,)
    assert np.isfinite(angles).all()
