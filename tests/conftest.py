"""What all tests share: a ROS graph of its own for every test file, and a small demonstration bag."""

import errno
import os
import random
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from rled_msgs_py.bags import BagWriter
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, Record, TaskStatus, Text
from rled_sim.kinematics import solve_position
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

from rled_msgs_py import topics

DOMAINS = [each for each in range(1, 102) if each != 87]
"""Not 0, everybody's default, nor 87, the demo's; above 101 the ports meet Linux's ephemeral ones."""

os.environ["MPLBACKEND"] = "Agg"
settings.register_profile("rled", deadline=None, derandomize=True)
settings.load_profile("rled")


def _taken(bind: socket.socket, address: str | tuple[str, int]) -> bool:
    try:
        bind.bind(address)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise
        return True
    return False


def _has_participant(domain: int) -> bool:
    # RTPS 2.3, 9.6.1.1: the first participant of a domain on a host listens on this UDP port
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        return _taken(probe, ("0.0.0.0", 7400 + 250 * domain + 10))


@contextmanager
def free_domain() -> Iterator[int]:
    """Hold a domain id that no other test run and no running participant has.

    The lock is an abstract Unix socket: like DDS it ends at the network namespace, and it goes when its process dies.
    """
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        with ExitStack() as stack:
            lock = stack.enter_context(closing(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)))
            if _taken(lock, f"\0rled-ros-domain-{domain}") or _has_participant(domain):
                continue
            yield domain
            return
    pytest.fail("all ROS domains from 1 to 101 are in use on this machine")


@pytest.fixture(scope="module", autouse=True)
def ros_domain() -> Iterator[int]:
    """The domain id of this test file, set in the environment for the nodes and processes that it starts."""
    with free_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        patch.delenv("ROS_STATIC_PEERS", raising=False)
        patch.delenv("ROS_DISCOVERY_SERVER", raising=False)
        yield domain


def demonstrated_motion(q: np.ndarray, goal: np.ndarray, max_delta: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """States and displacements of the demonstrated action, step by step from ``q`` until ``goal`` is met."""
    while (farthest := np.abs(goal - q).max()) > 1e-9:
        delta = min(farthest, max_delta) * (goal - q) / farthest
        yield q, delta
        q = q + delta


@pytest.fixture(scope="session")
def planar_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A demonstration of the planar arm: 25 points of its curve marked, then 12 motions from one to the next."""
    robot = ROBOTS["planar"]
    task, curve = reach_task(robot).description, reach_task(robot).targets[::16]
    joints = [solve_position(robot.chain, point, robot.home, robot.lower, robot.upper) for point in curve]
    path, stamp = tmp_path_factory.mktemp("demonstration") / "planar", 0
    with BagWriter(path) as bag:

        def write(**records: Record) -> None:
            for name, record in records.items():
                bag.write(getattr(topics, name), record)

        write(TASK_DESCRIPTION=Text(task.to_json()), ROBOT_DESCRIPTION=Text(robot.description))
        for q in joints:
            stamp += task.period
            ee = PoseSample(stamp, task.frame, robot.chain.position(q))
            write(MARKED_JOINT_STATES=JointSample(stamp, task.joint_names, q, np.zeros(2)), MARKED_EE_POSE=ee)
        order = np.random.default_rng(0).permutation(len(joints))[:13]
        for episode, (start, goal) in enumerate(pairwise(order)):
            for step, (q, delta) in enumerate(demonstrated_motion(joints[start], joints[goal], task.max_delta)):
                stamp += task.period
                write(
                    JOINT_STATES=JointSample(stamp, task.joint_names, q, np.zeros(2)),
                    EE_POSE=PoseSample(stamp, task.frame, robot.chain.position(q)),
                    TARGET_POSE=PoseSample(stamp, task.frame, curve[goal]),
                    TASK_STATUS=TaskStatus(stamp, episode, step, 0.0, 0, False, 0, False, False),
                    JOINT_DELTA=DeltaCommand(stamp, task.joint_names, delta),
                )
    return path


@pytest.fixture(scope="session")
def planar_expert(planar_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights of a small expert cloned from that demonstration: it reaches nearly every target."""
    import torch
    from rled_agent.data.opening import open_demonstrations
    from rled_agent.learners.cloning import CloningConfig, clone_expert
    from rled_agent.nn.architecture import Architecture

    torch.set_num_threads(1)
    config = CloningConfig(Architecture(hidden=(48, 48)), steps=1500)
    generator = np.random.default_rng(0)
    policy, _ = clone_expert(open_demonstrations(planar_bag, "points"), config, generator, lambda point: None)
    path = tmp_path_factory.mktemp("expert") / "expert.safetensors"
    policy.save(path)
    return path


def pytest_runtest_teardown() -> None:
    """Undo what a command run in this process sets for all of it; Hypothesis refuses to draw floats otherwise."""
    if torch := sys.modules.get("torch"):
        torch.set_flush_denormal(False)
