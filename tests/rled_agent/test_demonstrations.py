"""Demonstrations: ζᵇ in closed form against the same walked step by step, as recorded, and made worse on purpose."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rled_agent.data.closed_form import JoinedPoints, demonstration_points, joined_points
from rled_agent.data.corruption import Corruption
from rled_agent.data.demonstrations import DemonstrationError, DemonstrationPoints
from rled_agent.data.opening import open_demonstrations
from rled_agent.data.recorded import recorded_trajectories
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, Text
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

from rled_msgs_py import topics

PANDA, PLANAR = ROBOTS["panda"], ROBOTS["planar"]


def walked(zeta: JoinedPoints) -> list[tuple[int, int, np.ndarray, np.ndarray]]:
    """Every transition (i, j, q, Δq) of ζᵇ, walked with the demonstrated action from the state before it."""
    transitions = []
    joints, most = zeta.points.joints, zeta.task.max_delta
    for i, start in enumerate(joints):
        for j, goal in enumerate(joints):
            q = start
            while (farthest := max(abs(goal[k] - q[k]) for k in range(len(q)))) > 1e-9:
                delta = np.array([min(farthest, most) * (goal[k] - q[k]) / farthest for k in range(len(q))])
                transitions.append((i, j, q, delta))
                q = q + delta
    return transitions


def panda_points(count: int) -> JoinedPoints:
    spread = np.random.default_rng(1).uniform(-0.15, 0.15, (count, 7))
    joints = PANDA.home + spread
    return JoinedPoints(
        reach_task(PANDA).description, DemonstrationPoints(PANDA.chain.position(joints), joints), PANDA.chain
    )


def test_steps_of_three_points_are_those_counted_by_hand(three_points):
    assert len(three_points) == 2 * (3 + 5 + 3)


@pytest.mark.parametrize("points", ["three", "panda"])
def test_every_transition_is_the_one_that_the_demonstrated_action_walks(points, three_points):
    zeta = three_points if points == "three" else panda_points(6)
    expected = walked(zeta)
    assert len(zeta) == len(expected)
    moves = zeta.at(np.arange(len(zeta)))
    np.testing.assert_allclose(moves.q, [q for _, _, q, _ in expected], atol=1e-12)
    np.testing.assert_allclose(moves.action, [delta for *_, delta in expected], atol=1e-12)
    np.testing.assert_array_equal(moves.target, [zeta.points.positions[j] for _, j, _, _ in expected])
    np.testing.assert_allclose(moves.position, zeta.chain.position([q for _, _, q, _ in expected]), atol=1e-12)


def test_transitions_are_drawn_with_equal_weight(three_points):
    drawn = three_points.draw(22_000, np.random.default_rng(0))
    counts = Counter(
        (*q.round(6).tolist(), *target.round(6).tolist()) for q, target in zip(drawn.q, drawn.target, strict=True)
    )
    assert len(counts) == 22
    squared = sum((count - 1000) ** 2 / 1000 for count in counts.values())
    assert squared < 46.8  # chi-square, 21 degrees of freedom: exceeded once in 1000 seeds


def test_equal_points_are_joined_by_no_step(task):
    joints = np.array([[-0.5, 1.0], [-0.5, 1.0], [-0.5, 1.1]])
    zeta = JoinedPoints(task, DemonstrationPoints(PLANAR.chain.position(joints), joints), PLANAR.chain)
    assert len(zeta) == 4
    assert {tuple(goal) for goal in zeta.at(np.arange(4)).target.tolist()} == set(
        map(tuple, zeta.points.positions.tolist())
    )


def test_observations_of_the_panda_are_the_displacement_to_the_target_and_the_joints():
    zeta = panda_points(4)
    pairs = zeta.sample(50, np.random.default_rng(3))
    moves = zeta.draw(50, np.random.default_rng(3))
    tips = np.array([PANDA.chain.position(q) for q in moves.q])
    np.testing.assert_allclose(pairs.observations, np.hstack([moves.target - tips, moves.q]), atol=1e-15)
    np.testing.assert_array_equal(pairs.actions, moves.action)


def test_same_seed_draws_the_same_samples(zeta):
    one, same, other = (zeta.sample(100, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.observations, same.observations)
    np.testing.assert_array_equal(one.actions, same.actions)
    assert not np.array_equal(one.observations, other.observations)


def test_split_sets_whole_pairs_aside_and_loses_none(zeta):
    rest, aside = zeta.split(0.3, np.random.default_rng(0))
    assert not (rest.pairs & aside.pairs).any()
    assert (rest.pairs | aside.pairs).all()
    assert len(rest) + len(aside) == len(zeta)
    assert 0.2 < len(aside) / len(zeta) < 0.4
    both = [part.at(np.arange(len(part))) for part in (rest, aside)]
    everything = zeta.at(np.arange(len(zeta)))
    rows = [{(*q, *x) for q, x in zip(each.q, each.target, strict=True)} for each in (*both, everything)]
    assert rows[0] | rows[1] == rows[2]


def test_split_of_a_part_stays_within_it(zeta):
    rest, _ = zeta.split(0.5, np.random.default_rng(0))
    again, aside = rest.split(0.5, np.random.default_rng(1))
    assert len(again) + len(aside) == len(rest)
    assert not ((again.pairs | aside.pairs) & ~rest.pairs).any()


def test_marked_points_of_a_bag_are_read_in_the_order_of_the_task(planar_bag):
    points = demonstration_points(Bag(planar_bag))
    assert points.joints.shape == (25, 2)
    np.testing.assert_allclose(PLANAR.chain.position(points.joints), points.positions, atol=1e-12)
    np.testing.assert_allclose(points.positions, reach_task(PLANAR).targets[::16], atol=2e-4)


def test_so_many_of_the_marked_points_are_taken_evenly(planar_bag):
    every, few = (demonstration_points(Bag(planar_bag), count) for count in (0, 3))
    middle = (len(every.joints) - 1) // 2
    np.testing.assert_array_equal(few.joints[[0, 2]], every.joints[[0, -1]])
    assert any(np.array_equal(few.joints[1], every.joints[k]) for k in (middle, middle + 1))
    np.testing.assert_array_equal(demonstration_points(Bag(planar_bag), 10**6).joints, every.joints)
    assert len(joined_points(Bag(planar_bag), 3)) < len(joined_points(Bag(planar_bag)))


# Motions as they were recorded: which states were answered, what moved, and where it led to.


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


# Demonstrations that are made worse on purpose.


def draw(zeta, corruption: Corruption, size: int = 4000):
    return replace(zeta, corruption=corruption).draw(size, np.random.default_rng(5))


def test_a_trembling_hand_goes_wrong_in_nothing_but_its_displacements(zeta):
    good, shaken = draw(zeta, Corruption()), draw(zeta, Corruption(tremor=0.1))
    for name in ("q", "position", "target"):
        np.testing.assert_array_equal(getattr(shaken, name), getattr(good, name))
    most = zeta.task.max_delta
    assert np.abs(shaken.action).max() <= most
    inside = np.abs(good.action) < 0.5 * most  # five deviations from where it would be cut off
    noise = (shaken.action - good.action)[inside]
    assert noise.std() == pytest.approx(0.1 * most, rel=0.1)
    assert abs(noise.mean()) < 4 * 0.1 * most / np.sqrt(noise.size)


def test_what_was_shown_for_a_share_of_the_motions_is_another_target(zeta):
    points = len(zeta.points.joints)
    goals = Corruption(wrong=0.3).goals_shown(points).reshape(points, points)
    wrong = (goals != np.arange(points)).mean()
    assert abs(wrong - 0.3) < 4 * np.sqrt(0.3 * 0.7 / points**2)
    assert (Corruption(wrong=1.0).goals_shown(points).reshape(points, points) != np.arange(points)).all()
    assert (Corruption().goals_shown(points).reshape(points, points) == np.arange(points)).all()
    assert (Corruption(wrong=0.3, seed=1).goals_shown(points) != goals.ravel()).any()


def test_a_wrong_motion_is_a_good_one_to_another_point(zeta):
    good, wrong = draw(zeta, Corruption()), draw(zeta, Corruption(wrong=0.5))
    for name in ("q", "position", "action"):
        np.testing.assert_array_equal(getattr(wrong, name), getattr(good, name))
    differs = (wrong.target != good.target).any(axis=1)
    assert 0.4 < differs.mean() < 0.6
    shown = {tuple(target) for target in wrong.target[differs]}
    assert shown <= {tuple(point) for point in zeta.points.positions}


def test_parts_of_poor_demonstrations_are_as_poor(zeta):
    parts = replace(zeta, corruption=Corruption(tremor=0.2, wrong=0.1)).split(0.2, np.random.default_rng(0))
    assert [part.corruption for part in parts] == 2 * [Corruption(tremor=0.2, wrong=0.1)]


@pytest.mark.parametrize("given", [{"tremor": -0.1}, {"wrong": 1.1}, {"seed": -1}])
def test_flaws_that_cannot_be_are_refused(given):
    with pytest.raises(ContractError, match=f"{next(iter(given))} is .*; accepted: 0 to"):
        Corruption(**given)
