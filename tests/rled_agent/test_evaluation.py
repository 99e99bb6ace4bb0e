from dataclasses import replace

import numpy as np
import pytest
from rled_agent.data.demonstrations import DemonstrationPoints
from rled_agent.training.evaluation import DistanceBin, Trajectory, jerk, move, score, seen_bin, unseen_bin
from rled_msgs_py.errors import RledError
from rled_sim.robots import ROBOTS
from rled_sim.tasks import planar_risk, reach_task

CHAIN = ROBOTS["planar"].chain
SAFE = np.array([-0.5, 1.0])


def test_jerk_of_a_cubic_path_is_its_third_derivative():
    t = np.arange(20)[:, None] * 0.1
    path = np.hstack([2 * t**3, -(t**3) + 5 * t**2, 3 * t])  # third derivatives 12, -6, 0 m/s³
    assert jerk(path, 0.1) == pytest.approx(np.sqrt(12**2 + 6**2))


def test_jerk_of_a_parabola_is_zero():
    t = np.arange(10)[:, None] * 0.02
    assert jerk(np.hstack([t**2, t, t * 0]), 0.02) == pytest.approx(0.0, abs=1e-6)


def test_jerk_is_a_root_mean_square_over_time():
    assert jerk(np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 0], [8, 0, 0], [8, 0, 0]]), 2.0) == pytest.approx(
        np.sqrt((1.0**2 + 2.0**2) / 2)  # third differences 8 and -16 m, over 8 s³
    )


def motion(points, reached=True) -> Trajectory:
    positions = np.array(points, dtype=float)
    return Trajectory(reached, positions, np.tile(SAFE, (len(positions), 1)), np.zeros(3))


def test_score_is_the_one_worked_out_by_hand(task):
    square = motion([[0, 0, 0], [1, 0, 0], [1, 1, 0]])  # 2 m for a straight way of root 2
    straight = motion([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1.5, 0, 0], [2, 0, 0]])
    lost = motion([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0.008]], reached=False)
    found = score(task, [square, straight, lost, lost], lambda q, x: x[0] >= 1.0)
    assert found.success == 0.5
    assert found.steps == (2 + 4) / 2
    assert found.path_length == pytest.approx((2**0.5 + 1) / 2)
    assert found.violations == (2 + 3 + 0 + 0) / 4
    third = 0.008 / 0.02**3  # the square is too short for a third difference, the straight way has none
    assert found.jerk == pytest.approx(np.sqrt((0.0 + 2 * third**2) / 3), rel=1e-6)


def test_score_without_a_reached_target_has_no_steps(task):
    found = score(task, [motion([[0, 0, 0], [1, 0, 0]], reached=False)], planar_risk)
    assert found.success == 0.0
    assert np.isnan(found.steps)
    assert np.isnan(found.path_length)


def towards(task, joints):
    """A policy that walks to fixed joints, whatever it observes; it is told q by the position of one joint each."""
    state = {"q": None}

    def act(observation):
        delta = np.clip(joints - state["q"], -task.max_delta, task.max_delta)
        state["q"] = state["q"] + delta
        return delta

    return state, act


def test_motions_end_where_the_target_is_reached(task):
    starts = np.array([[-0.5, 1.0], [-0.5, 1.0]])
    goals = np.array([[-0.1, 1.0], [-0.5, 2.2]])  # 4 and 12 steps of 0.1 rad away
    state, act = towards(task, goals)
    state["q"] = starts.copy()
    group = DistanceBin("two", starts, CHAIN.position(goals))
    motions = move(task, CHAIN, act, group, 50)
    for each, start, goal, steps in zip(motions, starts, goals, (4, 12), strict=True):
        # a target counts when it is nearer than 3.16 cm, which may be a step before the goal itself
        walked = np.linspace(start, goal, steps + 1)
        distances = np.square(CHAIN.position(walked) - CHAIN.position(goal)).sum(axis=1)
        first = int(np.argmax(distances < task.tolerance))
        assert each.reached
        np.testing.assert_allclose(each.joints, walked[: first + 1], atol=1e-12)
        np.testing.assert_allclose(each.positions, CHAIN.position(walked[: first + 1]), atol=1e-12)
        np.testing.assert_allclose(each.target, CHAIN.position(goal), atol=1e-15)


def test_displacements_and_joints_stay_within_their_limits(task):
    group = DistanceBin("one", SAFE[None], np.array([[9.0, 9.0, 9.0]]))
    (lost,) = move(task, CHAIN, lambda observation: np.array([[0.0, 5.0]]), group, 40)
    assert not lost.reached
    assert np.abs(np.diff(lost.joints, axis=0)).max() <= task.max_delta + 1e-12
    assert lost.joints[-1, 1] == task.joint_upper[1]
    assert len(lost.joints) == 41


def test_standing_on_the_target_counts_after_the_first_step_only(task):
    group = DistanceBin("there", SAFE[None], CHAIN.position(SAFE)[None])
    (stays,) = move(task, CHAIN, lambda observation: np.zeros((1, 2)), group, 10)
    (leaves,) = move(task, CHAIN, lambda observation: np.array([[0.1, 0.0]]), group, 10)
    assert stays.reached
    assert len(stays.positions) == 2
    assert not leaves.reached
    assert len(leaves.positions) == 11


def test_a_target_reached_with_the_last_step_counts(task):
    goal = SAFE + np.array([0.3, 0.0])
    task = replace(task, tolerance=1e-6)
    state, act = towards(task, goal)
    state["q"] = SAFE[None].copy()
    (just,) = move(task, CHAIN, act, DistanceBin("last", SAFE[None], CHAIN.position(goal)[None]), 3)
    assert just.reached
    assert len(just.positions) == 4


def test_the_seen_bin_is_made_of_demonstrated_points(zeta):
    group = seen_bin(zeta.points, 200, np.random.default_rng(0))
    points, joints = ({tuple(row) for row in rows.tolist()} for rows in (zeta.points.positions, zeta.points.joints))
    assert {tuple(row) for row in group.targets.tolist()} == points
    assert {tuple(row) for row in group.starts.tolist()} == joints


@pytest.mark.parametrize("distances", [(0.02, 0.05), (0.05, 0.1)])
def test_targets_of_an_unseen_bin_keep_their_distance(zeta, distances):
    group = unseen_bin(zeta.task, CHAIN, zeta.points, distances, 60, np.random.default_rng(0))
    nearest = [min(np.linalg.norm(target - point) for point in zeta.points.positions) for target in group.targets]
    assert distances[0] <= min(nearest) < sum(distances) / 2 < max(nearest) <= distances[1]
    assert group.targets.shape == (60, 3)
    assert {tuple(row) for row in group.starts.tolist()} <= {tuple(row) for row in zeta.points.joints.tolist()}
    np.testing.assert_array_equal(group.targets[:, 2], zeta.points.positions[0, 2])
    assert group.name == f"{distances[0] * 100:g}-{distances[1] * 100:g} cm away"


def test_a_bin_without_enough_targets_is_refused(zeta):
    with pytest.raises(RledError, match=r"only 0 reachable targets 300-300 cm away; accepted: 3"):
        unseen_bin(zeta.task, CHAIN, zeta.points, (3.0, 3.0), 3, np.random.default_rng(0))


def test_targets_out_of_reach_are_left_out(zeta):
    group = unseen_bin(zeta.task, CHAIN, zeta.points, (0.1, 0.25), 10, np.random.default_rng(1))
    assert np.linalg.norm(group.targets[:, :2], axis=1).max() <= 1.0  # the two links are 0.5 m each


def test_bands_of_the_panda_lie_around_its_curve():
    robot = ROBOTS["panda"]
    task = reach_task(robot).description
    joints = np.array(robot.home) + np.random.default_rng(0).uniform(-0.1, 0.1, (5, 7))
    points = DemonstrationPoints(robot.chain.position(joints), joints)
    group = unseen_bin(task, robot.chain, points, (0.02, 0.05), 10, np.random.default_rng(0))
    nearest = [min(np.linalg.norm(target - point) for point in points.positions) for target in group.targets]
    assert 0.02 <= min(nearest) <= max(nearest) <= 0.05


def test_same_seed_gives_the_same_bin(zeta):
    one, same = (
        unseen_bin(zeta.task, CHAIN, zeta.points, (0.02, 0.05), 20, np.random.default_rng(3)) for _ in range(2)
    )
    np.testing.assert_array_equal(one.targets, same.targets)
    np.testing.assert_array_equal(one.starts, same.starts)
