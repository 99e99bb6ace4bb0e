"""ζᵇ in closed form against the same walked step by step."""

from collections import Counter

import numpy as np
import pytest
from rled_agent.data.closed_form import JoinedPoints, demonstration_points, joined_points
from rled_agent.data.demonstrations import DemonstrationPoints
from rled_msgs_py.bags import Bag
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

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
