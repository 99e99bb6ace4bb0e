from pathlib import Path

import numpy as np
import pytest
from rled_msgs_py.bags import BagWriter
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, TaskStatus
from rled_msgs_py.topics import (
    EE_POSE,
    JOINT_DELTA,
    JOINT_STATES,
    MARKED_EE_POSE,
    MARKED_JOINT_STATES,
    TARGET_POSE,
    TASK_STATUS,
)
from rled_teleop.recording.summary import summarise

PERIOD = 20_000_000
NAMES = ("shoulder", "elbow")


def write(path: Path, reached: list[tuple[int, int]], marked: set[int], unanswered: set[int], lost: set[int]) -> None:
    """A bag with one tick for each (episode, targets reached)."""
    with BagWriter(path) as bag:
        for k, (episode, targets) in enumerate(reached):
            stamp = k * PERIOD
            joints = JointSample(stamp, NAMES, np.zeros(2), np.zeros(2))
            pose = PoseSample(stamp, "world", np.zeros(3))
            if k not in lost:
                bag.write(JOINT_STATES, joints)
            bag.write(EE_POSE, pose)
            bag.write(TARGET_POSE, pose)
            bag.write(TASK_STATUS, TaskStatus(stamp, episode, k, 0.0, targets, False, 0, False, False))
            if k in marked:
                bag.write(MARKED_JOINT_STATES, joints)
                bag.write(MARKED_EE_POSE, pose)
            if k not in unanswered:
                bag.write(JOINT_DELTA, DeltaCommand(stamp, NAMES, np.zeros(2)))


def test_points_and_the_targets_reached_after_the_last_mark_are_counted(tmp_path: Path) -> None:
    # marks at ticks 0 and 2; after the mark 3 - 1 targets in episode 0, then 2 - 0 in episode 1
    reached = [(0, 0), (0, 1), (0, 1), (0, 2), (0, 3), (1, 0), (1, 2)]
    write(tmp_path / "bag", reached, marked={0, 2}, unanswered={6}, lost=set())
    summary = summarise(tmp_path / "bag")
    assert (summary.points, summary.trajectories, summary.states) == (2, 4, 7)
    assert (summary.messages, summary.unanswered, summary.lost) == (7 * 4 + 2 * 2 + 6, 0, 0)
    assert summary.seconds == pytest.approx(0.12)
    assert str(summary).endswith("2 points, 4 trajectories, 7 states, 0.12 s of simulation")


def test_states_without_an_answer_are_counted_the_last_one_aside(tmp_path: Path) -> None:
    write(tmp_path / "bag", [(0, 0)] * 5, marked=set(), unanswered={1, 2, 4}, lost=set())
    assert summarise(tmp_path / "bag").unanswered == 2


def test_a_lost_state_is_noticed(tmp_path: Path) -> None:
    write(tmp_path / "bag", [(0, 0)] * 5, marked=set(), unanswered={4}, lost={2})
    summary = summarise(tmp_path / "bag")
    assert summary.lost == 2  # a part of its tick is missing, and so is what its delta answers
    assert "LOST" in str(summary)
