"""Motions as they were recorded: which states were answered, what moved, and where it led to."""

from pathlib import Path

import numpy as np
import pytest
from rled_agent.data.closed_form import demonstration_points, joined_points
from rled_agent.data.demonstrations import DemonstrationError
from rled_agent.data.opening import open_demonstrations
from rled_agent.data.recorded import recorded_trajectories
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, Text
from rled_sim.robots import ROBOTS

from rled_msgs_py import topics

PLANAR = ROBOTS["planar"]


class Recording:
    """Writes a small bag of the planar arm, joint by joint as asked."""

    def __init__(self, path: Path, task) -> None:
        self.task, self.period = task, task.period
        self.bag = BagWriter(path)
        self.bag.write(topics.TASK_DESCRIPTION, Text(task.to_json()))
        self.bag.write(topics.ROBOT_DESCRIPTION, Text(PLANAR.description))

    def mark(self, tick: int, q, names=("shoulder", "elbow")) -> None:
        stamp = tick * self.period
        self.bag.write(topics.MARKED_JOINT_STATES, JointSample(stamp, names, np.array(q), np.zeros(2)))
        self.bag.write(topics.MARKED_EE_POSE, PoseSample(stamp, "world", PLANAR.chain.position(q)))

    def state(self, tick: int, q, target, delta=None, names=("shoulder", "elbow")) -> None:
        stamp = tick * self.period
        self.bag.write(topics.JOINT_STATES, JointSample(stamp, ("shoulder", "elbow"), np.array(q), np.zeros(2)))
        self.bag.write(topics.EE_POSE, PoseSample(stamp, "world", PLANAR.chain.position(q)))
        self.bag.write(topics.TARGET_POSE, PoseSample(stamp, "world", np.array(target)))
        if delta is not None:
            self.bag.write(topics.JOINT_DELTA, DeltaCommand(stamp, names, np.array(delta)))


@pytest.fixture
def recording(tmp_path, task):
    with (opened := Recording(tmp_path / "bag", task)).bag:
        yield opened


def test_recorded_trajectories_are_the_answered_states_after_the_last_mark(recording):
    first, second = (0.6, 0.1, 0.1), (0.7, -0.1, 0.1)
    recording.state(0, [-0.9, 1.8], first, [0.1, 0.1])  # on the way to a mark, for no target
    recording.mark(1, [-0.8, 1.5])
    recording.state(1, [-0.8, 1.5], first, [0.0, 0.1])
    recording.state(2, [-0.8, 1.6], first, [0.01, -0.02])
    recording.state(3, [-0.79, 1.58], first, [0.05, 0.06])
    recording.state(4, [-0.74, 1.64], second)  # the last of an episode: nobody answers it
    recording.state(5, [-0.74, 1.64], second, [0.1, -0.1])
    recording.bag.close()
    trajectories = recorded_trajectories(Bag(recording.bag.path))
    assert len(trajectories) == 3
    tips = PLANAR.chain.position([[-0.8, 1.6], [-0.79, 1.58], [-0.74, 1.64]])[:, :2]
    targets = [first[:2], first[:2], second[:2]]
    np.testing.assert_allclose(trajectories.answers.observations, np.hstack([tips, targets]), atol=1e-15)
    np.testing.assert_array_equal(trajectories.answers.actions, [[0.01, -0.02], [0.05, 0.06], [0.1, -0.1]])
    assert trajectories.answers.trajectory.tolist() == [0, 0, 1]


def test_joints_in_another_order_are_taken_by_name(recording):
    recording.mark(1, [-0.8, 1.5])
    for tick in (2, 3):
        recording.state(tick, [-0.8, 1.5], (0.6, 0.1, 0.1), [0.03, 0.01], names=("elbow", "shoulder"))
    recording.bag.close()
    np.testing.assert_array_equal(recorded_trajectories(Bag(recording.bag.path)).answers.actions, [[0.01, 0.03]] * 2)


def test_marks_in_another_order_are_taken_by_name(recording):
    for tick in (1, 2):
        recording.mark(tick, [1.5, -0.8], names=("elbow", "shoulder"))
    recording.bag.close()
    np.testing.assert_array_equal(demonstration_points(Bag(recording.bag.path)).joints, [[-0.8, 1.5]] * 2)


@pytest.mark.parametrize("read", [demonstration_points, recorded_trajectories])
def test_joints_of_other_names_are_refused(recording, read):
    for tick in (1, 2):
        recording.mark(tick, [-0.8, 1.5], names=("shoulder", "wrist"))
    for tick in (3, 4):
        recording.state(tick, [-0.8, 1.5], (0.6, 0.1, 0.1), [0.03, 0.01], names=("shoulder", "wrist"))
    recording.bag.close()
    with pytest.raises(RledError, match=r"shoulder, wrist.*accepted: shoulder, elbow"):
        read(Bag(recording.bag.path))


def test_a_bag_of_a_restarted_simulation_is_refused_as_trajectories(recording):
    for tick in (5, 6, 0, 1):
        recording.state(tick, [-0.8, 1.5], (0.6, 0.1, 0.1), [0.03, 0.01])
    recording.bag.close()
    with pytest.raises(DemonstrationError, match="restarted"):
        recorded_trajectories(Bag(recording.bag.path))


@pytest.mark.parametrize("marks", [0, 1])
def test_a_bag_with_fewer_than_two_marks_is_refused(recording, marks):
    recording.state(0, [-0.9, 1.8], (0.6, 0.1, 0.1))
    for tick in range(1, 1 + marks):
        recording.mark(tick, [-0.8, 1.5])
    recording.bag.close()
    with pytest.raises(DemonstrationError, match=rf"{marks} marked points; accepted: 2 or more"):
        joined_points(Bag(recording.bag.path))


def test_a_bag_without_answers_is_refused_as_trajectories(recording):
    recording.state(0, [-0.9, 1.8], (0.6, 0.1, 0.1))
    recording.bag.close()
    with pytest.raises(DemonstrationError, match="no recorded trajectory"):
        recorded_trajectories(Bag(recording.bag.path))


def test_both_sources_of_one_bag_show_the_same_motion(planar_bag):
    recorded = open_demonstrations(planar_bag, "trajectories")
    points = open_demonstrations(planar_bag, "points")
    everything = points.at(np.arange(len(points)))
    seen = points.task.observe(everything.q, everything.position, everything.target)
    for observation, action in zip(*recorded.answers[:2], strict=True):
        # the targets of the task and the marked points are up to 0.1 mm apart
        near = np.abs(np.hstack([seen - observation, everything.action - action])).max(axis=1)
        assert near.min() < 2e-4


def test_split_of_recorded_trajectories_sets_whole_ones_aside(planar_bag):
    recorded = open_demonstrations(planar_bag, "trajectories")
    rest, aside = recorded.split(0.25, np.random.default_rng(0))
    assert set(recorded.answers.trajectory) == set(range(12))
    assert len(set(aside.answers.trajectory)) == 3
    assert not set(rest.answers.trajectory) & set(aside.answers.trajectory)
    assert len(rest) + len(aside) == len(recorded)


def test_a_small_share_of_few_trajectories_is_at_least_one(planar_bag):
    recorded = open_demonstrations(planar_bag, "trajectories")
    rest, aside = recorded.split(0.01, np.random.default_rng(0))
    assert (len(set(rest.answers.trajectory)), len(set(aside.answers.trajectory))) == (11, 1)


def test_recorded_transitions_are_drawn_with_equal_weight(planar_bag):
    recorded = open_demonstrations(planar_bag, "trajectories")
    drawn = recorded.sample(100 * len(recorded), np.random.default_rng(0))
    _, counts = np.unique(drawn.observations, axis=0, return_counts=True)
    assert len(counts) == len(recorded)
    assert np.square(counts - 100).sum() / 100 < len(recorded) + 5 * np.sqrt(2 * len(recorded))


def test_points_are_counted_of_points_only(planar_bag):
    with pytest.raises(DemonstrationError, match="--points 3 with --source trajectories"):
        open_demonstrations(planar_bag, "trajectories", points=3)
