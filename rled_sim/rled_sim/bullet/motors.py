"""Position motors in PyBullet's joints, and the physics of one period."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import pybullet

from rled_sim.bullet.body import Body

MAX_SUBSTEP = 1.0 / 240.0
"""Longest step of the physics (s)."""
GAIN = 0.3
"""Position gain of the motors: the joints lag 0.02 rad behind a moving command and do not oscillate. Measured."""
MAX_LEAD = 2.0
"""Furthest that a motor's set point runs ahead of its joint, in units of Δq_max: a blocked joint must not wind up."""


class Driven(NamedTuple):
    """The motors after a period.

    Attributes:
        set_point: where they are to be (rad), n.
        q: where they are (rad), n.
        velocity: how fast they turn (rad/s), n.
    """

    set_point: list[float]
    q: list[float]
    velocity: list[float]


class Motors:
    """The motors of a body, with gravity, the URDF's velocity and torque limits, and contacts."""

    def __init__(self, body: Body, period: float) -> None:
        """Prepare the physics of periods (s)."""
        self._body = body
        self._lead = MAX_LEAD * body.robot.max_delta
        self._substeps = math.ceil(period / MAX_SUBSTEP - 1e-9)
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=body.client.number)
        pybullet.setTimeStep(period / self._substeps, physicsClientId=body.client.number)

    def drive(self, q: Sequence[float], set_point: Sequence[float]) -> Driven:
        """Let one period pass.

        Args:
            q: where the joints are (rad), n.
            set_point: where they are to be (rad), n.
        """
        body, client = self._body, self._body.client.number
        ahead = zip(set_point, q, strict=True)
        limited = [min(max(point, angle - self._lead), angle + self._lead) for point, angle in ahead]
        for index, joint, point in zip(body.joints, body.robot.joints, limited, strict=True):
            self._hold(index, point, joint.effort, joint.velocity)
        for info, point in body.held:
            self._hold(info[0], point, info[10], info[11])
        for _ in range(self._substeps):
            pybullet.stepSimulation(client)
        states = pybullet.getJointStates(body.number, body.joints, client)
        return Driven(limited, [state[0] for state in states], [state[1] for state in states])

    def _hold(self, index: int, point: float, force: float, speed: float) -> None:
        pybullet.setJointMotorControl2(
            self._body.number,
            index,
            pybullet.POSITION_CONTROL,
            targetPosition=point,
            force=force,
            maxVelocity=speed,
            positionGain=GAIN,
            physicsClientId=self._body.client.number,
        )
