"""What the robot has to keep within, drawn: workspace, keep-out zones, joint limits."""

from collections.abc import Collection
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.task_limits import Zone

from rled_teleop.web.robot import Colour, Link, RobotModel

Floats = NDArray[np.float64]

WORKSPACE: Colour = (120, 160, 210)
FORBIDDEN: Colour = (220, 38, 38)
ARC: Colour = (99, 102, 241)
ARC_RADIUS, ARC_STEPS = 0.11, 24


class LimitsView:
    """The limits of one task, in groups that are shown or hidden together.

    Args:
        server: of the page.
        task: with its limits.
        model: of the robot, whose joints have theirs.
        height: of the end effector (m), for a task in a horizontal plane.
    """

    def __init__(self, server: viser.ViserServer, task: TaskDescription, model: RobotModel, height: float) -> None:
        zones = [_zone(server, number, zone) for number, zone in enumerate(task.limits.keep_out)]
        self._groups = {
            "workspace": [_workspace(server, task, height)],
            "zones": [*_allowed(server, task), *zones],
            "joints": _arcs(server, task, model),
        }

    def show(self, shown: Collection[str]) -> None:
        """Show the groups ``workspace``, ``zones``, ``joints`` that are named, hide the others."""
        for name, handles in self._groups.items():
            for each in handles:
                each.visible = name in shown

    def remove(self) -> None:
        """Take all of it out of the scene."""
        for each in (each for handles in self._groups.values() for each in handles):
            each.remove()


def _workspace(server: viser.ViserServer, task: TaskDescription, height: float) -> Any:
    lower, upper = np.array([0.0, 0.0, height]), np.array([0.0, 0.0, height])
    lower[list(task.axes)], upper[list(task.axes)] = task.workspace_lower, task.workspace_upper
    return server.scene.add_line_segments("/limits/workspace", edges(lower, upper), WORKSPACE, thickness=0.002)


def _allowed(server: viser.ViserServer, task: TaskDescription) -> list[Any]:
    if not task.limits.tip_lower:
        return []
    box = edges(np.array(task.limits.tip_lower), np.array(task.limits.tip_upper))
    return [server.scene.add_line_segments("/limits/tip", box, FORBIDDEN, thickness=0.004)]


def _zone(server: viser.ViserServer, number: int, zone: Zone) -> Any:
    name = f"/limits/keep_out_{number}"
    style: dict[str, Any] = {"color": FORBIDDEN, "opacity": 0.3, "position": zone.centre, "cast_shadow": False}
    if zone.shape == "box":
        return server.scene.add_box(name, dimensions=(zone.size[0], zone.size[1], zone.size[2]), **style)
    if zone.shape == "sphere":
        return server.scene.add_icosphere(name, zone.size[0], **style)
    return server.scene.add_cylinder(name, zone.size[0], zone.size[1], **style)


def _arcs(server: viser.ViserServer, task: TaskDescription, model: RobotModel) -> list[Any]:
    """An arc from the lower to the upper limit of each joint that turns."""
    links = {link.joint: link for link in model.links if link.joint and not link.prismatic}
    drawn = []
    for name, low, high in zip(task.joint_names, task.joint_lower, task.joint_upper, strict=True):
        if link := links.get(name):
            path = f"/robot/{'/'.join(link.path[:-1])}/limits_{name}"
            drawn.append(server.scene.add_line_segments(path, arc(link, low, high), ARC, thickness=0.004))
    return drawn


def edges(lower: Floats, upper: Floats) -> NDArray[np.float32]:
    """The edges of a box between two corners (m); where they agree it is flat, shape (k, 2, 3)."""
    corners = [np.where(choice, upper, lower) for choice in np.ndindex(2, 2, 2)]
    pairs = {
        tuple(sorted((tuple(one), tuple(other))))
        for one in corners
        for other in corners
        if np.count_nonzero(one != other) == 1
    }
    return np.array(sorted(pairs), dtype=np.float32).reshape(-1, 2, 3)


def arc(link: Link, low: float, high: float) -> NDArray[np.float32]:
    """Where a link may turn about its joint, a spoke at each end, in the frame of its parent, shape (k, 2, 3)."""
    axis = link.axis / np.linalg.norm(link.axis)
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    angles = np.linspace(low, high, ARC_STEPS)[:, None]
    rim = ARC_RADIUS * (np.cos(angles) * first + np.sin(angles) * np.cross(axis, first))
    line = np.concatenate([np.zeros((1, 3)), rim, np.zeros((1, 3))]) @ link.origin[:3, :3].T + link.origin[:3, 3]
    return np.stack([line[:-1], line[1:]], axis=1).astype(np.float32)
