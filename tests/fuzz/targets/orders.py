"""What a driver's page commands, six numbers and a kind: the displacement stays finite and within Δq_max."""

import os
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from random import Random
from struct import pack, unpack

import numpy as np
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import PoseSample
from rled_sim.robots import ROBOTS
from rled_sim.target_request import requested_target
from rled_sim.tasks import reach_task
from rled_teleop.operators.jog import Jog
from rled_teleop.web.jog_command import Follow, Move, Turn
from rled_teleop.web.set_point import SetPoint, SetPointSlot
from rled_teleop.web.steering import steer

from ..mutators import plain

NUMBERS = (0.0, -0.0, 1.0, -1.0, float("nan"), float("inf"), 1e308, -1e308, 1e-308, 0.3)
KINDS = 4
FAR = 1e9
"""Metres or radians; the page takes no greater number from a visitor."""


@lru_cache
def jogs() -> list[Jog]:
    return [Jog(reach_task(robot).description, robot.chain) for robot in ROBOTS.values()]


def seeds() -> list[bytes]:
    return [bytes([kind]) + pack("<5d", 0.3, 0.2, 0.1, 0.5, 1.0) for kind in range(KINDS)]


def mutate(data: bytes, other: bytes, rng: Random) -> bytes:
    if rng.random() < 0.4:
        return plain.mutate(data, other, rng)
    at = 1 + 8 * rng.randrange(5)
    return data[:at] + pack("<d", rng.choice(NUMBERS)) + data[at + 8 :]


def read(data: bytes, _: Path) -> None:
    kind, *numbers, until = unpack("<B5d", data[:41].ljust(41, b"\0"))
    *point, share = np.clip(np.nan_to_num(numbers), (-FAR, -FAR, -FAR, 0.0), (FAR, FAR, FAR, 1.0)).tolist()
    slot = SetPointSlot()
    os.close(slot.file)  # the memory stays as long as the slot
    for robot, jog in zip(ROBOTS.values(), jogs(), strict=True):
        joint = kind // KINDS % jog.task.action_size
        command = (None, Follow(tuple(point)), Move(tuple(point)), Turn(joint, point[0]))[kind % KINDS]
        slot.put(SetPoint(command, until, share, bool(kind & 64)))
        set_point = slot.newest()
        assert set_point.command == command, "another command than was given"
        delta = steer(set_point, jog, np.array(robot.home), 0.0)
        if delta is not None:
            assert np.isfinite(delta).all(), "a displacement that is no number"
            assert np.abs(delta).max() <= jog.task.max_delta * (1 + 1e-9), "a displacement beyond Δq_max"
        with suppress(RledError):
            request = PoseSample(0, jog.task.frame, np.array(numbers[:3]))
            target = requested_target(request, jog.task, (0.0, 0.0, 0.0))
            assert np.isfinite(target).all(), "a target that is no number"
