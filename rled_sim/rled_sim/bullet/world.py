"""The plant that PyBullet simulates: displaced joints, or motors and physics."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError

from rled_sim.bullet.body import Body
from rled_sim.bullet.client import Client
from rled_sim.bullet.motors import Motors
from rled_sim.bullet.scene import Scene
from rled_sim.plant import Contact, Point
from rled_sim.robots import Robot

Transition = Literal["kinematic", "motors"]

OF_A_CLIENT = {"_client", "_body", "_motors", "_scene", "_collision_world"}
"""What belongs to one PyBullet client, and to no copy."""


class World:
    """A robot on a floor, moved by joint displacements: a ``Plant``.

    ``kinematic`` is Eq. 4.28: the joints are put at clip(q + Δq) and the tool's pose is read. ``motors`` moves the
    set point of position motors by Δq and lets the physics run for one period; the set point is what is displaced, so
    that a robot told to stay does not sag.

    A world that nobody holds any more is closed. Copied or unpickled it is another one in the same state.

    Attributes:
        robot: the robot.
        q: joint angles (rad), n.
        position: origin of the tip link in the frame ``world`` (m).
        orientation: of the tip link in the frame ``world``: x, y, z, w.
    """

    def __init__(self, robot: Robot, transition: Transition, period: float, gui: bool = False) -> None:
        """Open a world of its own.

        Args:
            robot: the robot.
            transition: how a displacement moves it.
            period: time between two displacements (s).
            gui: show PyBullet's window.

        Raises:
            RledError: no window can be opened.
        """
        if transition not in get_args(Transition):
            raise RledError(f"transition '{transition}'", ", ".join(get_args(Transition)))
        self.robot, self._period, self._kinematic = robot, period, transition == "kinematic"
        self._lower, self._upper, self._gui = robot.lower, robot.upper, gui
        self._open()
        self.place(robot.home)

    def _open(self) -> None:
        self._client = Client(self._gui)
        try:
            self._body = Body(self._client, self.robot)
            self._motors = Motors(self._body, self._period)
        except BaseException:
            self._client.close()
            raise
        self._scene = Scene(self._client, self.robot.camera)
        self._collision_world: World | None = None

    def __getstate__(self) -> dict[str, Any]:
        """What another world needs to be in the same state.

        Raises:
            RledError: this one has a window, or is closed.
        """
        if self._gui:
            raise RledError("a world with a window is not copied", "", "copy one without render_mode 'human'")
        self.require_open()
        state = {name: each for name, each in self.__dict__.items() if name not in OF_A_CLIENT}
        return state if self._kinematic else state | {"physics": self._client.saved()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Open a world in that state."""
        physics = state.pop("physics", None)
        self.__dict__.update(state)
        self._open()
        if physics is None:
            self._body.displace(self.q)
        else:
            self._client.restore(physics)
        self._read_tip()

    def require_open(self) -> None:
        """Refuse what needs an open world.

        Raises:
            RledError: it is closed.
        """
        if not self._client.is_open:
            raise RledError("the environment is closed", "an open one", "make it again")

    def place(self, q: Sequence[float]) -> None:
        """Put the robot at rest at joint angles (rad), n of them."""
        self.q = self._previous = self._set_point = list(q)
        self._velocity = [0.0] * len(self.q)
        self._body.place(self.q)
        self._read_tip()

    def move(self, delta: Sequence[float]) -> None:
        """Displace the joints by Δq (rad), n finite numbers, within the joint limits; one period passes."""
        self._previous = self.q
        if self._kinematic:
            self.q = self._clipped(self.q, delta)
            self._body.displace(self.q)
        else:
            self._set_point, self.q, self._velocity = self._motors.drive(self.q, self._clipped(self._set_point, delta))
        self._read_tip()

    def halt(self) -> None:
        """Ask the motors for no further motion."""
        self._set_point = list(self.q)

    def _clipped(self, q: Sequence[float], delta: Sequence[float]) -> list[float]:
        moved = []
        for angle, change, lower, upper in zip(q, delta, self._lower, self._upper, strict=True):
            sum_ = angle + change
            moved.append(lower if sum_ < lower else upper if sum_ > upper else sum_)
        return moved

    def _read_tip(self) -> None:
        self.position, self.orientation = self._body.tip()

    @property
    def physical(self) -> bool:
        """The robot is moved by physics."""
        return not self._kinematic

    @property
    def set_point(self) -> list[float]:
        """Joint angles that a displacement is added to (rad), n: the motors' set point, or where the joints are."""
        return self.q if self._kinematic else self._set_point

    @property
    def velocity(self) -> list[float]:
        """Joint rates (rad/s), n: of the physics, or Δq over the period where joints are displaced."""
        if not self._kinematic:
            return self._velocity
        return [(now - before) / self._period for now, before in zip(self.q, self._previous, strict=True)]

    def contacts(self) -> list[Contact]:
        """What the robot touches in this state."""
        return sorted(self._body.contacts())

    def touches(self, q: NDArray[np.float64]) -> Mapping[Contact, float]:
        """What the robot would touch at joint angles (rad), shape (n,), and how deep (m); nothing moves here."""
        self._collision_world = self._collision_world or World(self.robot, "kinematic", self._period)
        self._collision_world.place(q.tolist())
        return self._collision_world._body.contacts()

    def show_target(self, position: Point) -> None:
        """Draw the target in pictures and in the window."""
        self._scene.show_target(position)

    def picture(self) -> NDArray[np.uint8]:
        """What the robot's camera sees, shape (480, 640, 3)."""
        return self._scene.picture()

    def close(self) -> None:
        """Close the world; a second call does nothing."""
        if self._collision_world is not None:
            self._collision_world.close()
        self._client.close()
