"""A robot on a floor, as PyBullet has loaded them: where it is, and what it touches."""

import os
from collections.abc import Sequence
from typing import Any

import pybullet
from pybullet_data import getDataPath

from rled_sim.bullet.client import Client
from rled_sim.plant import Contact, Point, Quaternion
from rled_sim.robots import Robot

CONTACT_DISTANCE = 1e-3
"""Distance below which two bodies touch (m)."""


class Body:
    """The robot and the floor of one client.

    Attributes:
        client: the client.
        robot: the robot.
        number: the robot's, in the client.
        floor: the floor's, in the client.
        joints: numbers of the n joints.
        held: PyBullet's descriptions of the joints that are held, and where (rad or m).
    """

    def __init__(self, client: Client, robot: Robot) -> None:
        """Load both, the robot at home."""
        self.client, self.robot = client, robot
        p, number = pybullet, client.number
        self.floor = p.loadURDF(os.path.join(getDataPath(), "plane.urdf"), physicsClientId=number)
        flags = p.URDF_USE_SELF_COLLISION
        self.number = p.loadURDF(str(robot.urdf), useFixedBase=True, flags=flags, physicsClientId=number)
        infos = [p.getJointInfo(self.number, i, number) for i in range(p.getNumJoints(self.number, number))]
        joints, links = ({info[column].decode(): info[0] for info in infos} for column in (1, 12))
        self._link_names = {index: name for name, index in links.items()} | {-1: "base"}
        self.joints = [joints[name] for name in robot.joint_names]
        self.held = [(infos[joints[name]], value) for name, value in robot.held.items()]
        self._tip = links[robot.tip_link]
        self.place(robot.home)
        for contact in self._contact_points():
            # Links of one rigid body whose shapes overlap in the URDF would report a contact for ever.
            p.setCollisionFilterPair(self.number, self.number, contact[3], contact[4], 0, number)

    def place(self, q: Sequence[float]) -> None:
        """Put the joints at angles (rad), n, and the held ones where they are held, all at rest."""
        self.displace(q)
        for info, value in self.held:
            pybullet.resetJointState(self.number, info[0], value, 0.0, self.client.number)

    def displace(self, q: Sequence[float]) -> None:
        """Put the joints at angles (rad), n."""
        pybullet.resetJointStatesMultiDof(
            self.number, self.joints, [(angle,) for angle in q], physicsClientId=self.client.number
        )

    def tip(self) -> tuple[Point, Quaternion]:
        """Position (m) and orientation of the tip link."""
        # Positional: link velocity 0, forward kinematics 1. Entries 4 and 5 are the link's frame, 0 its centre of mass.
        state = pybullet.getLinkState(self.number, self._tip, 0, 1, self.client.number)
        return state[4], state[5]

    def contacts(self) -> dict[Contact, float]:
        """What the robot touches, and how deep (m)."""
        found: dict[Contact, float] = {}
        for point in self._contact_points():
            other = "floor" if point[2] == self.floor else self._link_names[point[4]]
            contact = Contact(self._link_names[point[3]], other)
            found[contact] = max(found.get(contact, 0.0), CONTACT_DISTANCE - point[8])
        return found

    def _contact_points(self) -> list[tuple[Any, ...]]:
        pybullet.performCollisionDetection(self.client.number)
        points = pybullet.getContactPoints(bodyA=self.number, physicsClientId=self.client.number)
        return [point for point in points if point[8] < CONTACT_DISTANCE]
