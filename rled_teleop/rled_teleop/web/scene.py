"""What stands in the view, the same for all visitors: robot, target, curve, trail, ghost of a replay."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick

from rled_teleop.web.limits_view import LimitsView
from rled_teleop.web.robot import Colour, Link, RobotModel, pose_of
from rled_teleop.web.trail import Pieces

TARGET: Colour = (220, 38, 38)
CURVE: Colour = (110, 118, 132)
GHOST: Colour = (96, 139, 214)
TARGET_RADIUS = 0.018
FIELD_OF_VIEW = 0.8
"""Of the camera, from top to bottom (rad)."""
NO_PIECES = Pieces(np.zeros((1, 2, 3), np.float32), np.zeros((1, 2, 3), np.uint8))
"""Viser wants one piece at least; one without a length is not seen."""


class Camera(NamedTuple):
    """A view: from where to where (m)."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]


def camera_for(task: TaskDescription) -> Camera:
    """From above for a task in a horizontal plane, else from beside."""
    if 2 not in task.axes:
        return Camera((0.5, -0.75, 1.6), (0.5, 0.0, 0.1))
    return Camera((1.75, -1.35, 1.0), (0.22, 0.0, 0.4))


class DrawnRobot:
    """A robot whose links are moved.

    Args:
        server: of the page.
        name: of the node of the scene that all of it hangs under.
        model: what it looks like.
        ghost: draw it transparent and in one colour.
    """

    def __init__(self, server: viser.ViserServer, name: str, model: RobotModel, ghost: bool = False) -> None:
        self._server = server
        self.root = server.scene.add_frame(name, show_axes=False)
        self._moving: list[tuple[Link, Any]] = []
        style: dict[str, Any] = {"opacity": 0.35, "cast_shadow": False, "color": GHOST} if ghost else {}
        for link in model.links:
            path, (position, wxyz) = f"{name}/{'/'.join(link.path)}", pose_of(link, {})
            frame = server.scene.add_frame(path, show_axes=False, position=position, wxyz=wxyz)
            for number, shape in enumerate(link.shapes):
                options = {"color": shape.colour} | style
                server.scene.add_mesh_simple(f"{path}/shape_{number}", shape.vertices, shape.faces, **options)
            if link.joint:
                self._moving.append((link, frame))

    def move(self, angles: Mapping[str, float]) -> None:
        """Show joint angles by name (rad or m)."""
        with self._server.atomic():
            for link, frame in self._moving:
                if link.joint in angles:
                    frame.position, frame.wxyz = pose_of(link, angles)


class Scene:
    """Everything in the view but the handles that the driver drags.

    Args:
        server: of the page.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._server, scene = server, server.scene
        self._model: RobotModel | None = None
        self._robot: DrawnRobot | None = None
        self._ghost: DrawnRobot | None = None
        self._limits: LimitsView | None = None
        self._curve: Sequence[tuple[float, float, float]] = ()
        self._shown: Pieces | None = None
        self._looks: NDArray[np.float64] | None = None
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        scene.configure_default_lights(cast_shadow=False)  # they cost half of the frames where there is no GPU
        scene.add_grid("/floor", 3.0, 3.0, cell_size=0.1, section_size=0.5, cell_color=(226, 229, 234),
                       section_color=(196, 202, 212), shadow_opacity=0.0, position=(0.0, 0.0, -0.002))  # fmt: skip
        self._tool = scene.add_frame("/tool", axes_length=0.06, axes_radius=0.003, visible=False)
        self._target = scene.add_icosphere("/target", TARGET_RADIUS, color=TARGET, visible=False)
        self._trail = scene.add_line_segments("/trail", *NO_PIECES, thickness=0.005)

    def draw(self, model: RobotModel, task: TaskDescription, tick: Tick) -> None:
        """Show a robot and its task, in place of another."""
        for drawn in (self._robot, self._ghost):
            if drawn is not None:
                drawn.root.remove()
        if self._limits is not None:
            self._limits.remove()
        self._model, self._ghost, self._looks = model, None, None
        self._robot = DrawnRobot(self._server, "/robot", model)
        self._limits = LimitsView(self._server, task, model, float(tick.ee.position[2]))
        radius = float(np.sqrt(task.tolerance))
        self._server.scene.add_icosphere("/target/tolerance", radius, color=TARGET, opacity=0.12, cast_shadow=False)
        self._tool.visible = self._target.visible = True
        start = self._server.initial_camera
        start.fov, (start.position, start.look_at) = FIELD_OF_VIEW, camera_for(task)
        self.move(tick)

    def draw_curve(self, points: Sequence[tuple[float, float, float]]) -> None:
        """Show the curve that targets are drawn from (m), if it is another one."""
        if points is self._curve:
            return
        self._curve = points
        line = np.array(points, dtype=np.float32).reshape(-1, 3)
        pieces = np.stack([line[:-1], line[1:]], axis=1) if len(line) > 1 else NO_PIECES.points
        self._server.scene.add_line_segments("/curve", pieces, CURVE, thickness=0.004)

    def show_limits(self, shown: Collection[str]) -> None:
        """Show the limits named, see ``LimitsView.show``."""
        if self._limits is not None:
            self._limits.show(shown)

    def move(self, tick: Tick) -> None:
        """Show a tick; nothing is sent when it looks like the one before."""
        looks = np.concatenate([tick.joints.position, tick.ee.position, tick.target.position])
        if self._looks is not None and np.array_equal(looks, self._looks):
            return
        self._looks = looks
        with self._server.atomic():
            self._tool.position, self._target.position = tick.ee.position, tick.target.position
            x, y, z, w = tick.ee.orientation
            self._tool.wxyz = (w, x, y, z)
            if self._robot is not None:
                self._robot.move(dict(zip(tick.joints.names, tick.joints.position.tolist(), strict=True)))

    def draw_trail(self, pieces: Pieces | None) -> None:
        """Show the path of the tool, if it has changed; None hides it."""
        pieces = pieces if pieces is not None and len(pieces.points) else NO_PIECES
        if self._shown is None or not np.array_equal(pieces.points, self._shown.points):
            self._shown = pieces
            with self._server.atomic():
                self._trail.points, self._trail.colors = pieces

    def move_ghost(self, angles: Mapping[str, float]) -> None:
        """Show a replayed robot beside the real one."""
        if self._ghost is None and self._model is not None:
            self._ghost = DrawnRobot(self._server, "/ghost", self._model, ghost=True)
        if self._ghost is not None:
            self._ghost.root.visible = True
            self._ghost.move(angles)

    def hide_ghost(self) -> None:
        """End a replay."""
        if self._ghost is not None:
            self._ghost.root.visible = False
