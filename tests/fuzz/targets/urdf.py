"""The description of a robot: its kinematics, and what the page draws."""

from pathlib import Path

import numpy as np
from rled_msgs_py.errors import RledError
from rled_sim.kinematics import Chain
from rled_teleop.web.robot import load_robot, pose_of

from ...rled_teleop.conftest import URDF
from ..mutators.texts import mutate_xml as mutate

__all__ = ["REFUSALS", "mutate", "read", "seeds"]

NAMES = ("shoulder", "elbow")
REFUSALS = (RledError, ValueError)
"""``load_robot`` says ValueError of a text that is no URDF; the page shows no robot then."""

LOOKS = """<visual><origin xyz="0 0 0.1" rpy="0 1.5 0"/><geometry><cylinder radius="0.02" length="0.5"/></geometry>
<material name="grey"><color rgba="0.5 0.5 0.5 1"/></material></visual>
<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>
<visual><geometry><mesh filename="package://meshes/none.stl" scale="1 1 1"/></geometry></visual>"""


def seeds() -> list[bytes]:
    drawn = URDF.replace('<link name="upper"/>', f'<link name="upper">{LOOKS}</link>')
    return [URDF.encode(), drawn.encode()]


def read(data: bytes, _: Path) -> None:
    text = data.decode(errors="replace")
    try:
        chain = Chain.from_urdf(text, "tip", NAMES)
    except RledError:
        chain = None
    if chain is not None:
        q = np.zeros((2, 2))
        assert np.isfinite(chain.position(q)).all(), "a place that is no number"
        assert np.isfinite(chain.jacobian(q)).all(), "a Jacobian that is no number"
    load_robot.cache_clear()
    model = load_robot(text)
    for link in model.links:
        pose_of(link, dict.fromkeys(NAMES, 0.3))
