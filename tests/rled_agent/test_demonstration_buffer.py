"""Demonstrated transitions are paid for by the task, as an environment would pay for them."""

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from rled_agent.data.closed_form import JoinedPoints
from rled_agent.data.demonstration_buffer import BLOCK, DemonstrationBuffer
from rled_agent.data.demonstrations import DemonstrationPoints, Demonstrations
from rled_agent.data.recorded import RecordedTrajectories, recorded_trajectories
from rled_agent.nn.scaling import Scaling
from rled_agent.replay.transitions import Source, Transitions
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, TaskStatus, Text
from rled_sim.kinematics import solve_position
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

from rled_msgs_py import topics

from ..conftest import demonstrated_motion

PLANAR = ROBOTS["planar"]
AS_IT_IS = Scaling(np.zeros(4), np.ones(4), np.zeros(2), np.ones(2))
GAMMA = 0.5


def drawn(
    demonstrations: Demonstrations, size: int, seed: int = 0, scaling: Scaling = AS_IT_IS, **changes: object
) -> Transitions:
    """A batch of one seed, without its dimension; the changes are of the task."""
    task = replace(demonstrations.task, **changes)
    batch = DemonstrationBuffer(demonstrations, task, scaling, GAMMA, [seed]).sample(size)
    return Transitions(*(each[0] for each in batch))


def rows_of(zeta: Demonstrations, size: int, seed: int = 0, **changes: object) -> np.ndarray:
    """s (4), a (2), r, 1 where the task ends, and s' (4) of a batch."""
    batch = drawn(zeta, size, seed, **changes)
    ends = 1.0 - batch.discount / GAMMA
    return np.hstack([batch.observation, batch.action, batch.reward, ends, batch.next_observation])


@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_rows_are_the_transitions_of_the_task(three_points, reward):
    robot = ROBOTS["planar"]
    task = reach_task(robot, reward=reward)
    rows = rows_of(three_points, 400, reward=reward)
    moves = three_points.at(np.arange(len(three_points)))
    states = np.hstack([moves.position[:, :2], moves.target[:, :2]])
    seen = set()
    for row in rows:
        k = int(np.abs(states - row[:4]).sum(axis=1).argmin())  # which of the 22 transitions
        seen.add(k)
        q = moves.q[k] + moves.action[k]
        tip = tuple(robot.chain.position(q))
        squared = sum((a - b) ** 2 for a, b in zip(tip, moves.target[k], strict=True))
        reached = squared < 1e-3
        assert sum((moves.position[k] - moves.target[k]) ** 2) >= 1e-3
        np.testing.assert_allclose(row[:4], states[k], atol=1e-6)
        np.testing.assert_allclose(row[4:6], moves.action[k], atol=1e-6)
        assert row[6] == pytest.approx(task.reward(squared, reached, task.risky(q, tip)), abs=1e-5)
        assert row[7] == reached  # one target ends the episode
        np.testing.assert_allclose(row[8:10], tip[:2], atol=1e-6)
        if not reached:
            np.testing.assert_allclose(row[10:12], moves.target[k][:2], atol=1e-6)
    assert len(seen) > 10
    assert 0 < rows[:, 7].sum() < 400


def test_a_reached_target_is_followed_by_any_of_the_points(three_points):
    rows = rows_of(three_points, 3000)
    ended = rows[rows[:, 7] == 1]
    following, changed = ended[:, 10:12], (ended[:, 10:12] != ended[:, 2:4]).any(axis=1)
    assert changed.mean() == pytest.approx(2 / 3, abs=4 * (2 / 9 / len(ended)) ** 0.5)
    points, counts = np.unique(following.round(5), axis=0, return_counts=True)
    np.testing.assert_allclose(points, np.unique(three_points.points.positions[:, :2].round(5), axis=0), atol=1e-5)
    assert np.square(counts - counts.mean()).sum() / counts.mean() < 13.8  # chi-square, 2 degrees: once in 1000


@pytest.mark.parametrize(("targets", "share"), [(0, 0.0), (1, 1.0), (4, 0.25)])
def test_a_reached_target_is_the_last_one_as_often_as_it_is_in_an_episode(three_points, targets, share):
    rows = rows_of(three_points, 5000, reward="sparse", targets_per_episode=targets)
    reached = rows[:, 6] > 0
    assert not rows[~reached, 7].any()
    count = reached.sum()
    assert abs(rows[reached, 7].mean() - share) <= 4 * np.sqrt(share * (1 - share) / count)


def test_transitions_are_in_the_units_of_the_scaling_and_say_where_they_come_from(three_points):
    doubled = Scaling(np.ones(4), np.full(4, 2.0), np.zeros(2), np.full(2, 0.1))
    plain, scaled = (drawn(three_points, 50, scaling=scaling) for scaling in (AS_IT_IS, doubled))
    for name, factor, center in (("observation", 2, 1), ("next_observation", 2, 1), ("action", 0.1, 0)):
        expected = (getattr(plain, name) - center) / factor
        np.testing.assert_allclose(getattr(scaled, name), expected, atol=1e-6)
    for batch in (plain, scaled):
        np.testing.assert_array_equal(batch.reward, plain.reward)
        assert (batch.source == Source.DEMONSTRATION).all()
        assert batch.demonstrated.all()
        assert (batch.weight == 1.0).all()
        assert batch.indices.shape == (50,)


def test_same_seed_draws_the_same_rows(three_points):
    np.testing.assert_array_equal(rows_of(three_points, 50, seed=1), rows_of(three_points, 50, seed=1))
    assert not np.array_equal(rows_of(three_points, 50, seed=1), rows_of(three_points, 50, seed=2))


def buffer(demonstrations: Demonstrations, *seeds: int, gamma: object = GAMMA) -> DemonstrationBuffer:
    return DemonstrationBuffer(demonstrations, demonstrations.task, AS_IT_IS, gamma, seeds)


def test_a_seed_draws_the_transitions_that_it_draws_alone(three_points):
    together, alone = buffer(three_points, 4, 5, 6), [buffer(three_points, seed) for seed in (4, 5, 6)]
    for size in (1000, 7, 7, 3000, 3000, BLOCK + 1, 1):
        batch, own = together.sample(size), [each.sample(size) for each in alone]
        assert batch.observation.shape == (3, size, 4)
        for whole, *parts in zip(batch, *own, strict=True):
            assert torch.equal(whole, torch.cat(parts))


def test_discounts_are_those_of_each_seed(three_points):
    gamma = torch.tensor([0.9, 0.99], dtype=torch.float64)
    together, alone = buffer(three_points, 4, 5, gamma=gamma), [
        buffer(three_points, seed, gamma=each) for seed, each in ((4, 0.9), (5, 0.99))
    ]  # fmt: skip
    batch, own = together.sample(200), [each.sample(200) for each in alone]
    assert torch.equal(batch.discount, torch.cat([each.discount for each in own]))
    assert [set(each.view(-1).tolist()) for each in batch.discount] == [
        {0.0, float(np.float32(0.9))}, {0.0, float(np.float32(0.99))}
    ]  # fmt: skip


@pytest.mark.parametrize("size", [7, 100, BLOCK, BLOCK + 1])
def test_batches_are_what_a_block_holds_in_order_and_none_comes_twice(zeta, size):
    """So many batches are drawn at once; the next block follows, of other transitions."""
    one, whole = buffer(zeta, 0), buffer(zeta, 0)
    count = max(BLOCK // size, 1)
    rows = [torch.cat([one.sample(size).rows() for _ in range(count)], dim=1) for _ in range(2)]
    whole._draw(size)
    assert torch.equal(rows[0], whole._rows)
    assert not torch.equal(*rows)


@pytest.mark.parametrize("before", [[], [7], [7] * 600, [50, 50, 7, 7], [BLOCK - 1, 2, 5000]])
def test_it_goes_on_from_its_place(three_points, before):
    one, other = buffer(three_points, 4, 5), buffer(three_points, 4, 5)
    for size in before:
        one.sample(size)
    other.sample(33)
    other.load_state_dict(json.loads(json.dumps(one.state_dict())))
    for size in (7, 7, 100, 4000, 4000, 7):
        left, right = one.sample(size), other.sample(size)
        assert all(torch.equal(mine, theirs) for mine, theirs in zip(left, right, strict=True))
    assert one.state_dict() == other.state_dict()


@pytest.mark.parametrize("change", [{"block": -1}, {"size": 1.5}, {"used": None}, {"size": 10**9}, {"block": "1"}])
def test_what_is_no_place_in_the_draws_is_refused(three_points, change):
    there = buffer(three_points, 4)
    there.sample(5)
    with pytest.raises(RledError, match=r"demonstrations at .*; accepted: a place in their draws"):
        there.load_state_dict(there.state_dict() | change)


def test_points_within_one_targets_tolerance_are_refused(task):
    joints = np.array([[-0.5, 1.0], [-0.5, 1.01]])
    chain = ROBOTS["planar"].chain
    zeta = JoinedPoints(task, DemonstrationPoints(chain.position(joints), joints), chain)
    with pytest.raises(RledError, match="marked points"):
        drawn(zeta, 1)


def test_a_demonstration_in_closed_form_that_goes_through_a_risky_state_is_paid_the_penalty(task):
    joints = np.array([[1.9, 1.2], [2.3, 1.2]])  # 0.4 rad, 4 steps: the shoulder may turn to 2 rad
    zeta = JoinedPoints(task, DemonstrationPoints(PLANAR.chain.position(joints), joints), PLANAR.chain)
    batch = drawn(zeta, 400, reward="sparse")
    shoulder = np.array([each[0] for each in _joints(batch.next_observation[:, :2].numpy())])
    paid = batch.reward[:, 0].numpy() - 10.0 * (1.0 - batch.discount[:, 0].numpy() / GAMMA)
    np.testing.assert_allclose(paid, np.where(shoulder > 2.0, -1.0, 0.0))
    assert 0.3 < (shoulder > 2.0).mean() < 1.0


def _joints(positions: np.ndarray) -> Iterator[np.ndarray]:
    for x, y in positions:
        yield solve_position(PLANAR.chain, np.array([x, y, 0.1]), np.array([2.1, 1.2]), PLANAR.lower, PLANAR.upper)


class Paid(list):
    """What the environment gave while it was recorded: (s, a, r, whether the task ended, s') of each step."""


def record(path: Path, targets: int, reward: str, motions: int) -> Paid:
    """Demonstrate in a real environment what goes through risky states, holds now and then, and ends in a bag."""
    env = gymnasium.make(
        "rled/PlanarReach-v0", reward=reward, targets_per_episode=targets, start_joints=[[1.95, 1.2]], max_steps=0
    )
    task, simulation = env.unwrapped.task, env.unwrapped.simulation
    paid, stamp = Paid(), 0
    with BagWriter(path) as bag:
        bag.write(topics.TASK_DESCRIPTION, Text(task.to_json()))
        bag.write(topics.ROBOT_DESCRIPTION, Text(PLANAR.description))

        def tick(number: int, reward: float, terminated: bool, delta: np.ndarray | None) -> None:
            nonlocal stamp
            stamp, episode = stamp + task.period, simulation.episode
            world = simulation.plant
            q, position, target = (np.array(each) for each in (world.q, world.position, episode.target))
            bag.write(topics.JOINT_STATES, JointSample(stamp, task.joint_names, q, np.zeros(2)))
            bag.write(topics.EE_POSE, PoseSample(stamp, task.frame, position))
            bag.write(topics.TARGET_POSE, PoseSample(stamp, task.frame, target))
            counts = episode.targets_reached, episode.risky, episode.violations
            bag.write(
                topics.TASK_STATUS,
                TaskStatus(stamp, number, episode.steps, reward, *counts, terminated, False),
            )
            if delta is not None:
                bag.write(topics.JOINT_DELTA, DeltaCommand(stamp, task.joint_names, delta))

        for number in range(motions):
            before, _ = env.reset(seed=number)
            outcome = 0.0, False
            while not outcome[1]:
                for delta in _wanted(simulation, turn=simulation.episode.steps == 0):
                    tick(number, *outcome, delta)
                    for _ in range(number % 3):  # nobody answers for a while: the robot holds, which is no step
                        simulation.hold()
                        tick(number, *outcome, None)
                    after, earned, ended, _, _ = env.step(delta.astype(np.float32))
                    paid.append((before, delta, earned, ended, after))
                    is_new = simulation.episode.targets_reached and tuple(before[2:]) != tuple(after[2:])
                    before, outcome = after, (float(earned), ended)
                    if ended or is_new:
                        break
            tick(number, *outcome, None)
    env.close()
    return paid


def _wanted(simulation, turn: bool) -> Iterator[np.ndarray]:
    """Displacements to the target, at first by a way on which the shoulder is turned too far."""
    if turn:
        yield from np.array([[0.1, 0.0], [0.1, -0.02], [0.05, 0.05], [-0.1, 0.0]])
    goal = solve_position(PLANAR.chain, simulation.episode.target, PLANAR.home, PLANAR.lower, PLANAR.upper)
    q = np.array(simulation.plant.q)
    for _, delta in demonstrated_motion(q, goal, simulation.task.description.max_delta):
        yield delta


@pytest.mark.parametrize(("reward", "targets"), [("dense", 1), ("sparse", 1), ("dense", 3)])
def test_a_recorded_motion_is_paid_what_the_environment_paid_while_it_was_recorded(tmp_path, reward, targets):
    paid = record(tmp_path / "bag", targets, reward, 4)
    recorded = recorded_trajectories(Bag(tmp_path / "bag"))
    assert len(recorded.carried_out.q) == len(paid)  # ticks in which the robot held are one state
    batch = drawn(recorded, 20 * len(paid))
    states = np.array([before for before, *_ in paid])
    seen = set()
    for k in range(len(batch.reward)):
        number = int(np.abs(states - batch.observation[k].numpy()).sum(axis=1).argmin())
        before, delta, earned, ended, after = paid[number]
        seen.add(number)
        np.testing.assert_allclose(batch.observation[k], before, atol=1e-6)
        np.testing.assert_allclose(batch.action[k], delta, atol=1e-6)
        np.testing.assert_allclose(batch.next_observation[k], after, atol=1e-6)
        assert float(batch.reward[k]) == pytest.approx(earned, abs=1e-5)
        assert float(batch.discount[k]) == (0.0 if ended else GAMMA)
    assert seen == set(range(len(paid)))
    risky = [earned < -0.9 for _, _, earned, _, _ in paid if reward == "sparse"]
    assert not risky or 4 <= sum(risky) < len(paid)


def test_a_demonstration_of_other_episodes_than_are_learned_in_ends_as_often_as_those(tmp_path):
    record(tmp_path / "bag", 1, "sparse", 6)
    recorded = recorded_trajectories(Bag(tmp_path / "bag"))
    rows = rows_of(recorded, 5000, targets_per_episode=4)
    reached = rows[:, 6] > 5.0
    assert not rows[~reached, 7].any()
    assert rows[reached, 7].mean() == pytest.approx(0.25, abs=4 * (0.25 * 0.75 / reached.sum()) ** 0.5)


def test_parts_of_recorded_motions_are_whole(tmp_path):
    record(tmp_path / "bag", 1, "dense", 4)
    recorded: RecordedTrajectories = recorded_trajectories(Bag(tmp_path / "bag"))
    parts = recorded.split(0.5, np.random.default_rng(0))
    assert sum(len(part.carried_out.q) for part in parts) == len(recorded.carried_out.q)
    shown = (np.hstack([part.carried_out.next_q, part.carried_out.target]) for part in parts)
    firsts, seconds = ({tuple(row) for row in rows.tolist()} for rows in shown)
    assert not firsts & seconds
    for part in parts:
        assert set(part.moved) == set(part.answers.trajectory)
        assert len(part.starts) == 2
        np.testing.assert_allclose(part.starts, [[1.95, 1.2]] * 2)
        assert all((one == other).all() for one, other in pairwise(part.starts))
