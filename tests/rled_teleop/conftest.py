"""A two-link arm in pure Python: what the scripted operator needs of a simulation, and nothing more."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, TaskStatus
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_sim.kinematics import Chain

from ..rled_msgs_py.samples import NAMES, TASK

URDF = """<robot name="arm">
<link name="world"/><link name="upper"/><link name="lower"/><link name="tip"/>
<joint name="shoulder" type="revolute"><parent link="world"/><child link="upper"/><axis xyz="0 0 1"/>
  <limit lower="-3.14" upper="3.14" effort="1" velocity="1"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 0 1"/>
  <origin xyz="0.5 0 0"/><limit lower="0" upper="3" effort="1" velocity="1"/></joint>
<joint name="wrist" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0.5 0 0"/></joint>
</robot>"""


def tip(q: np.ndarray) -> np.ndarray:
    x = 0.5 * np.cos(q[0]) + 0.5 * np.cos(q[0] + q[1])
    y = 0.5 * np.sin(q[0]) + 0.5 * np.sin(q[0] + q[1])
    return np.array([x, y, 0.0])


class Arm:
    """An endless reach task with the arm above: applies a delta, gives the next tick."""

    def __init__(self, task: TaskDescription, targets: np.ndarray, seed: int = 0) -> None:
        self.task, self.targets = task, targets
        self.generator = np.random.default_rng(seed)
        self.q, self.step, self.reached = np.array([-0.8, 1.6]), 0, 0
        self._draw()

    def _draw(self) -> None:
        self.target = self.targets[self.generator.integers(len(self.targets))]

    def tick(self) -> Tick:
        stamp = self.step * self.task.period
        return Tick(
            JointSample(stamp, NAMES, self.q, np.zeros(2)),
            PoseSample(stamp, "world", tip(self.q)),
            PoseSample(stamp, "world", self.target),
            TaskStatus(stamp, 0, self.step, 0.0, self.reached, False, 0, False, False),
        )

    def apply(self, command: DeltaCommand) -> None:
        assert command.stamp == self.step * self.task.period
        assert np.abs(command.delta).max() <= self.task.max_delta
        self.q = np.clip(self.q + command.delta, self.task.joint_lower, self.task.joint_upper)
        self.step += 1
        if np.square(tip(self.q) - self.target).sum() < self.task.tolerance:
            self.reached += 1
            self._draw()


@pytest.fixture
def task() -> TaskDescription:
    return replace(
        TASK, robot="arm", joint_lower=(-3.14, 0.0), joint_upper=(3.14, 3.0), targets_per_episode=0, max_steps=0
    )


@pytest.fixture
def chain() -> Chain:
    return Chain.from_urdf(URDF, "tip", NAMES)


@pytest.fixture
def circle() -> Callable[[int], np.ndarray]:
    def points(count: int) -> np.ndarray:
        angle = 2 * np.pi * np.arange(count) / count
        return np.stack([0.65 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), np.zeros(count)], axis=1)

    return points


@pytest.fixture
def arm(task: TaskDescription, circle: Callable[[int], np.ndarray]) -> Iterator[Arm]:
    return Arm(task, circle(100))
