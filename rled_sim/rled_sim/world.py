"""The simulated world, and the only module that imports PyBullet."""

import contextlib
import math
import os
import sys
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from pybullet_data import getDataPath
from rled_msgs_py.errors import RledError

from rled_sim.quiet import quiet
from rled_sim.robots import Robot

with quiet():  # it prints when it was built, which would stand beside a command's one line
    import pybullet

Transition = Literal["kinematic", "motors"]
Point = tuple[float, float, float]

SUBSTEP = 1.0 / 240.0
"""Longest step of the physics (s)."""
GAIN = 0.3
"""Position gain of the motors: the joints lag 0.02 rad behind a moving command and do not oscillate. Measured."""
LEASH = 2.0
"""Furthest that a motor's set point runs ahead of its joint, in units of Δq_max: a blocked joint must not wind up."""
TOUCHING = 1e-3
"""Distance below which two bodies touch (m)."""
OF_A_CLIENT = {"_client", "_end", "_target", "_ghost"}
"""What belongs to one PyBullet client, and to no copy."""
PICTURE = (640, 480)
"""Width and height of a rendered picture."""


class Contact(NamedTuple):
    """A link of the robot that touches something: the floor, or another link."""

    link: str
    other: str


class World:
    """A robot on a floor, moved by joint displacements.

    ``kinematic`` is Eq. 4.28: the joints are put at clip(q + Δq) and the tool's pose is read. ``motors`` moves the
    set point of position motors by Δq and lets the physics run for one period, with gravity, the URDF's velocity and
    torque limits and contacts; the set point is what is displaced, so that a robot told to stay does not sag.

    A world that nobody holds any more is closed. Copied or unpickled it is another one in the same state.

    Attributes:
        robot: the robot.
        home: joint angles at rest (rad), n.
        q: joint angles (rad), n.
        position: origin of the tip link in the frame ``world`` (m).
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
        self.home = list(robot.home)
        if transition not in get_args(Transition):
            raise RledError(f"transition '{transition}'", ", ".join(get_args(Transition)))
        self.robot, self._period, self._kinematic = robot, period, transition == "kinematic"
        self._lower, self._upper, self._gui = robot.lower, robot.upper, gui
        self._open()

    def _open(self) -> None:
        self._client = _connect(self._gui)
        self._end = weakref.finalize(self, _disconnect, self._client, os.getpid())
        self._target: int | None = None
        self._ghost: World | None = None
        try:
            self._load()
        except BaseException:
            self.close()
            raise

    def _load(self) -> None:
        p, client = pybullet, self._client
        self._substeps = math.ceil(self._period / SUBSTEP - 1e-9)
        p.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        p.setTimeStep(self._period / self._substeps, physicsClientId=client)
        self._floor = p.loadURDF(os.path.join(getDataPath(), "plane.urdf"), physicsClientId=client)
        flags = p.URDF_USE_SELF_COLLISION
        self._body = p.loadURDF(str(self.robot.urdf), useFixedBase=True, flags=flags, physicsClientId=client)
        infos = [p.getJointInfo(self._body, i, client) for i in range(p.getNumJoints(self._body, client))]
        joints, links = ({info[column].decode(): info[0] for info in infos} for column in (1, 12))
        self._link_names = {index: name for name, index in links.items()} | {-1: "base"}
        self._joints = [joints[name] for name in self.robot.joint_names]
        self._held = [(infos[joints[name]], value) for name, value in self.robot.held.items()]
        self._tip = links[self.robot.tip_link]
        self.place(self.robot.home)
        for contact in self._touching():
            # Links of one rigid body whose shapes overlap in the URDF would report a contact for ever.
            p.setCollisionFilterPair(self._body, self._body, contact[3], contact[4], 0, client)

    def __getstate__(self) -> dict[str, Any]:
        """What another world needs to be in the same state.

        Raises:
            RledError: this one has a window, or is closed.
        """
        if self._gui:
            raise RledError("a world with a window is not copied", "", "copy one without render_mode 'human'")
        self.require_open()
        state = {name: each for name, each in self.__dict__.items() if name not in OF_A_CLIENT}
        return state if self._kinematic else state | {"physics": self._saved()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Open a world in that state."""
        physics = state.pop("physics", None)
        self.__dict__.update(state)
        self._open()
        self.__dict__.update(state)  # what loading has put at home
        if physics is None:
            self._displace()
        else:
            self._restore(physics)
        self._read_tip()

    def _saved(self) -> bytes:
        """Positions, velocities and contacts of all bodies, as PyBullet writes them."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "state.bullet")
            pybullet.saveBullet(str(path), physicsClientId=self._client)
            return path.read_bytes()

    def _restore(self, physics: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "state.bullet")
            path.write_bytes(physics)
            pybullet.restoreState(fileName=str(path), physicsClientId=self._client)

    def require_open(self) -> None:
        """Refuse what needs an open world.

        Raises:
            RledError: it is closed.
        """
        if self._client < 0:
            raise RledError("the environment is closed", "an open one", "make it again")

    def place(self, q: Sequence[float]) -> None:
        """Put the robot at rest at joint angles (rad), n of them."""
        self.q = self._previous = self._set_point = list(q)
        self._displace()
        self._velocity = [0.0] * len(self.q)
        for info, value in self._held:
            pybullet.resetJointState(self._body, info[0], value, 0.0, self._client)
        self._read_tip()

    def move(self, delta: Sequence[float]) -> None:
        """Displace the joints by Δq (rad), n finite numbers, within the joint limits; one period passes."""
        self._previous = self.q
        if self._kinematic:
            self.q = self._clipped(self.q, delta)
            self._displace()
        else:
            self._set_point = self._clipped(self._set_point, delta)
            self._drive()
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

    def _displace(self) -> None:
        pybullet.resetJointStatesMultiDof(
            self._body, self._joints, [(angle,) for angle in self.q], physicsClientId=self._client
        )

    def _drive(self) -> None:
        p, leash = pybullet, LEASH * self.robot.max_delta
        ahead = zip(self._set_point, self.q, strict=True)
        self._set_point = [min(max(point, angle - leash), angle + leash) for point, angle in ahead]
        for index, joint, point in zip(self._joints, self.robot.joints, self._set_point, strict=True):
            self._hold(index, point, joint.effort, joint.velocity)
        for info, point in self._held:
            self._hold(info[0], point, info[10], info[11])
        for _ in range(self._substeps):
            p.stepSimulation(self._client)
        states = p.getJointStates(self._body, self._joints, self._client)
        self.q, self._velocity = [state[0] for state in states], [state[1] for state in states]

    def _hold(self, index: int, point: float, force: float, speed: float) -> None:
        pybullet.setJointMotorControl2(
            self._body,
            index,
            pybullet.POSITION_CONTROL,
            targetPosition=point,
            force=force,
            maxVelocity=speed,
            positionGain=GAIN,
            physicsClientId=self._client,
        )

    def _read_tip(self) -> None:
        # Positional: link velocity 0, forward kinematics 1. Entries 4 and 5 are the link's frame, 0 its centre of mass.
        state = pybullet.getLinkState(self._body, self._tip, 0, 1, self._client)
        self.position: Point = state[4]
        self.orientation: tuple[float, float, float, float] = state[5]

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
        return sorted({self._contact(point) for point in self._touching()})

    def touches(self, q: NDArray[np.float64]) -> dict[tuple[str, str], float]:
        """What the robot would touch at joint angles (rad), shape (n,), and how deep (m); nothing moves here."""
        self._ghost = self._ghost or World(self.robot, "kinematic", self._period)
        self._ghost.place(q.tolist())
        found: dict[tuple[str, str], float] = {}
        for point in self._ghost._touching():
            pair = self._ghost._contact(point)
            found[pair] = max(found.get(pair, 0.0), TOUCHING - point[8])
        return found

    def _touching(self) -> list[tuple[Any, ...]]:
        pybullet.performCollisionDetection(self._client)
        points = pybullet.getContactPoints(bodyA=self._body, physicsClientId=self._client)
        return [point for point in points if point[8] < TOUCHING]

    def _contact(self, point: tuple[Any, ...]) -> Contact:
        other = "floor" if point[2] == self._floor else self._link_names[point[4]]
        return Contact(self._link_names[point[3]], other)

    def show_target(self, position: Point) -> None:
        """Draw the target in pictures and in the window."""
        p, client = pybullet, self._client
        if self._target is None:
            colour = (0.85, 0.1, 0.1, 1.0)
            ball = p.createVisualShape(p.GEOM_SPHERE, radius=0.02, rgbaColor=colour, physicsClientId=client)
            self._target = p.createMultiBody(baseVisualShapeIndex=ball, physicsClientId=client)
        p.resetBasePositionAndOrientation(self._target, position, (0.0, 0.0, 0.0, 1.0), client)

    def picture(self) -> NDArray[np.uint8]:
        """What the robot's camera sees, shape (480, 640, 3)."""
        p, camera, (width, height) = pybullet, self.robot.camera, PICTURE
        view = p.computeViewMatrixFromYawPitchRoll(
            camera.target, camera.distance, camera.yaw, camera.pitch, 0, upAxisIndex=2
        )
        lens = p.computeProjectionMatrixFOV(50.0, width / height, 0.05, 10.0)
        image = p.getCameraImage(width, height, view, lens, renderer=p.ER_TINY_RENDERER, physicsClientId=self._client)
        return np.reshape(image[2], (height, width, 4))[..., :3].astype(np.uint8)

    def close(self) -> None:
        """Close the world; a second call does nothing."""
        if self._ghost is not None:
            self._ghost.close()
        self._end()
        self._client = -1


def _disconnect(client: int, process: int) -> None:
    """Free a client's memory; a forked process leaves alone what is its parent's."""
    if os.getpid() == process:
        with contextlib.suppress(pybullet.error):  # its window was closed by hand
            pybullet.disconnect(client)


def has_display() -> bool:
    """Whether a window can be opened; PyBullet ends the process where it cannot."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY"))


def _connect(gui: bool) -> int:
    if not gui:
        return int(pybullet.connect(pybullet.DIRECT))
    if not has_display():
        raise RledError("no display for PyBullet's window", "an X display in DISPLAY", "leave the window out")
    return int(pybullet.connect(pybullet.GUI))
