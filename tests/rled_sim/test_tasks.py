"""Tasks, and the curve that their targets are drawn from."""

import math
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import ContractError
from rled_sim.envs import ReachEnv
from rled_sim.episode_state import Episode
from rled_sim.kinematics import solve_position
from rled_sim.lemniscate import lemniscate
from rled_sim.robots import ROBOTS
from rled_sim.sim_params import SimParams
from rled_sim.tasks import panda_risk, planar_risk, reach_task, squared_distance, task_of_description

from rled_sim import ENVIRONMENTS

PANDA, PLANAR = ROBOTS["panda"], ROBOTS["planar"]
HERE = (0.5, 0.0, 0.5)


def begun(task, position=HERE, target=HERE, q=(0.0,) * 7):
    return Episode(task, q, position, target)


def away(distance):
    return (HERE[0], HERE[1], HERE[2] + distance)


def test_dense_reward_is_minus_the_squared_distance():
    # sqrt(0.09 + 0.16) = 0.5, squared 0.25: being far away costs
    assert squared_distance((0.3, 0.0, 0.4), (0.0, 0.0, 0.0)) == pytest.approx(0.25)
    episode = begun(reach_task(PANDA), target=away(0.5))
    assert episode.advance((0.0,) * 7, HERE, np.random.default_rng(0)).reward == pytest.approx(-0.25)


def test_dense_reward_of_a_reached_target_adds_u():
    episode = begun(reach_task(PANDA), target=away(0.01))
    assert episode.advance((0.0,) * 7, HERE, np.random.default_rng(0)).reward == pytest.approx(1000 - 1e-4)


@pytest.mark.parametrize(("distance", "reward"), [(0.5, 0.0), (0.01, 1000.0)])
def test_sparse_reward_is_u_or_nothing(distance, reward):
    episode = begun(reach_task(PANDA, reward="sparse"), target=away(distance))
    assert episode.advance((0.0,) * 7, HERE, np.random.default_rng(0)).reward == reward


@pytest.mark.parametrize(("distance", "reached"), [(0.0547, 1), (0.0548, 0)])
def test_threshold_is_compared_with_the_squared_distance(distance, reached):
    # sqrt(0.003) is 0.05477
    episode = begun(reach_task(PANDA), target=away(distance))
    episode.advance((0.0,) * 7, HERE, np.random.default_rng(0))
    assert episode.targets_reached == reached


def test_exactly_the_threshold_is_not_reached():
    task = reach_task(PANDA)
    task = replace(task, description=replace(task.description, tolerance=0.25))
    episode = begun(task, position=(0.0, 0.0, 0.0), target=(0.5, 0.0, 0.0))
    episode.advance((0.0,) * 7, (0.0, 0.0, 0.0), np.random.default_rng(0))
    assert episode.targets_reached == 0


def test_reached_target_is_followed_by_another():
    task, rng = reach_task(PANDA), np.random.default_rng(0)
    expected = tuple(task.targets[int(1572 * np.random.default_rng(0).random())])
    episode = begun(task)
    episode.advance((0.0,) * 7, HERE, rng)
    assert episode.target == expected


def test_fifteenth_target_terminates():
    episode, rng = begun(reach_task(PANDA)), np.random.default_rng(0)
    outcomes = [episode.advance((0.0,) * 7, episode.target, rng) for _ in range(15)]
    assert [outcome.terminated for outcome in outcomes] == [False] * 14 + [True]
    assert not any(outcome.truncated for outcome in outcomes)
    assert episode.over


def test_last_target_stays():
    episode = begun(reach_task(PANDA, targets_per_episode=1), target=away(0.01))
    episode.advance((0.0,) * 7, HERE, np.random.default_rng(0))
    assert episode.target == away(0.01)


def test_step_999_truncates():
    episode, rng = begun(reach_task(PANDA), target=away(0.3)), np.random.default_rng(0)
    outcomes = [episode.advance((0.0,) * 7, HERE, rng) for _ in range(999)]
    assert [outcome.truncated for outcome in outcomes] == [False] * 998 + [True]
    assert not any(outcome.terminated for outcome in outcomes)


def test_last_target_on_the_last_step_terminates_and_does_not_truncate():
    episode = begun(reach_task(PANDA, targets_per_episode=1, max_steps=1))
    assert episode.advance((0.0,) * 7, HERE, np.random.default_rng(0))[1:] == (True, False)


def test_target_reached_on_a_truncated_step_is_followed_by_another():
    # the value of that state is bootstrapped, so it must have a target ahead
    episode = begun(reach_task(PANDA, max_steps=1))
    assert episode.advance((0.0,) * 7, HERE, np.random.default_rng(0))[1:] == (False, True)
    assert episode.target != HERE


def test_zero_limits_never_end():
    episode, rng = begun(reach_task(PANDA, targets_per_episode=0, max_steps=0)), np.random.default_rng(0)
    assert not any(any(episode.advance((0.0,) * 7, episode.target, rng)[1:]) for _ in range(1100))


@pytest.mark.parametrize(("height", "risky"), [(0.051, False), (0.049, True), (-0.1, True)])
def test_panda_risk_is_a_tool_near_the_floor(height, risky):
    assert panda_risk((0.0,) * 7, (0.5, 0.0, height)) is risky


@pytest.mark.parametrize(
    ("shoulder", "radius", "risky"),
    [
        (0.0, 0.41, False),
        (0.0, 0.39, True),
        (0.0, 0.94, False),
        (0.0, 0.96, True),
        (1.99, 0.6, False),
        (2.01, 0.6, True),
        (-2.01, 0.6, True),
    ],
)
def test_planar_risks_by_hand(shoulder, radius, risky):
    assert planar_risk((shoulder, 1.0), (0.0, radius, 0.1)) is risky


def test_planar_risk_costs_one_and_is_counted():
    rng, q = np.random.default_rng(0), (0.0, 0.0)
    episode = begun(reach_task(PLANAR), position=(1.0, 0.0, 0.1), target=(0.6, 0.0, 0.1), q=q)
    assert (episode.risky, episode.violations) == (True, 1)
    assert episode.advance(q, (1.0, 0.0, 0.1), rng).reward == pytest.approx(-0.16 - 1.0)
    assert (episode.risky, episode.violations) == (True, 2)
    assert episode.advance(q, (0.9, 0.0, 0.1), rng).reward == pytest.approx(-0.09)
    assert (episode.risky, episode.violations) == (False, 2)


def test_planar_target_is_worth_ten():
    episode = begun(reach_task(PLANAR), position=(0.6, 0.0, 0.1), target=(0.62, 0.0, 0.1), q=(0.0, 0.0))
    outcome = episode.advance((0.0, 0.0), (0.6, 0.0, 0.1), np.random.default_rng(0))
    assert outcome.reward == pytest.approx(10 - 4e-4)
    assert outcome.terminated


@given(st.integers(0, 399), st.integers(0, 399))
def test_demonstrated_straight_line_between_planar_targets_never_violates(i, j):
    targets = reach_task(PLANAR).targets
    limits = (np.add(PLANAR.lower, 1e-9), np.subtract(PLANAR.upper, 1e-9))
    q, goal = (solve_position(PLANAR.chain, targets[k], PLANAR.home, *limits) for k in (i, j))
    for _ in range(200):
        assert not planar_risk(q, tuple(PLANAR.chain.position(q)))
        furthest = np.abs(goal - q).max()
        if furthest == 0.0:
            break
        q = q + min(furthest, PLANAR.max_delta) * (goal - q) / furthest
    assert np.abs(goal - q).max() < 1e-12


def test_home_and_every_target_are_safe():
    for robot, risk in ((PANDA, panda_risk), (PLANAR, planar_risk)):
        assert not risk(robot.home, tuple(robot.chain.position(robot.home)))
    for x, y, _ in reach_task(PLANAR).targets:
        assert 0.40 < math.hypot(x, y) < 0.95


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_states_judged_together_have_the_rewards_of_their_steps(name, reward):
    robot = ROBOTS[name]
    env = ReachEnv(name, reward=reward, max_steps=0, targets_per_episode=0)
    env.reset(seed=3)
    simulation, rng = env.simulation, np.random.default_rng(4)
    rows, goals = [], simulation.task.targets
    for k in range(600):
        if k % 100 == 0:  # so that some targets are reached
            env.simulation.episode.target = tuple(robot.chain.position(np.add(simulation.plant.q, 0.02)).tolist())
        elif k % 100 > 50:
            env.simulation.episode.target = tuple(goals[k].tolist()) if k < len(goals) else (0.5, 0.0, 0.1)
        target = simulation.episode.target
        before = simulation.episode.targets_reached
        drift = (k // 100 % 3 - 1) * 0.6 * robot.max_delta  # far enough to states that are risky
        action = rng.uniform(-robot.max_delta, robot.max_delta, len(robot.home)) + drift
        _, paid, *_, info = env.step(action)
        reached = simulation.episode.targets_reached > before
        rows.append((simulation.plant.q, simulation.plant.position, target, paid, reached, info["risky"]))
    q, position, target, paid, reached, risky = map(np.array, zip(*rows, strict=True))
    assert reached.any()
    assert risky.any() or name == "panda"
    assert not risky.all()
    assert [each.tolist() for each in simulation.task.judge(q, position, target)] == [
        paid.tolist(),
        reached.tolist(),
        risky.tolist(),
    ]
    tensors = simulation.task.judge(*map(torch.from_numpy, (q, position, target)))
    np.testing.assert_allclose(tensors.reward.numpy(), paid, rtol=1e-12)
    env.close()


def test_the_task_of_a_description_has_its_settings():
    description = reach_task(PLANAR, reward="sparse", max_steps=7).description
    task = task_of_description(description)
    assert task.description == description
    assert (task.penalty, task.risky) == (1.0, planar_risk)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"robot": "ur5"}, "robot 'ur5' has no task; accepted: a robot that has one: panda, planar"),
        ({"joint_names": ("elbow", "shoulder")}, "'planar' with the joints elbow, shoulder; accepted: shoulder, elbow"),
    ],
)
def test_the_task_of_a_description_of_no_such_robot_is_refused(changed, said):
    with pytest.raises(ContractError, match=said):
        task_of_description(replace(reach_task(PLANAR).description, **changed))


def test_targets_are_drawn_evenly():
    task, rng = reach_task(PLANAR), np.random.default_rng(3)
    drawn = [task.draw_target(rng) for _ in range(40_000)]
    _, counts = np.unique(np.array(drawn), axis=0, return_counts=True)
    # the curve passes its double point twice, so 399 places; 100 draws each, one standard deviation 10
    assert len(counts) >= 399
    assert np.sort(counts)[:-1].max() < 160
    assert counts.min() > 50


@pytest.mark.parametrize(("robot", "axes"), [(PANDA, 3), (PLANAR, 2)])
def test_targets_are_spread_around_their_points_along_the_axes_of_the_task(robot, axes):
    task, point = reach_task(robot, target_spread=0.1), (0.4, 0.3, 0.2)
    rng = np.random.default_rng(4)
    spread = np.array([replace(task, targets=np.array([point])).draw_target(rng) for _ in range(10_000)]) - point
    assert (spread[:, axes:] == 0.0).all()
    assert np.abs(spread).max() <= 0.1
    # evenly: mean 0 and deviation 0.2 / √12, each within four standard errors
    assert np.abs(spread[:, :axes].mean(axis=0)).max() < 4 * 0.0577 / 100
    assert spread[:, :axes].std(axis=0) == pytest.approx([0.0577] * axes, abs=0.0015)


@pytest.mark.parametrize("spread", [-0.1, 1.5, math.nan])
def test_a_spread_that_is_no_length_is_refused(spread):
    with pytest.raises(ContractError, match=f"target_spread is {spread}; accepted: 0 to 1 m"):
        reach_task(PANDA, target_spread=spread)


def test_unknown_reward_is_refused():
    with pytest.raises(ContractError, match="reward 'shaped'; accepted: dense, sparse"):
        reach_task(PANDA, reward="shaped")


def test_a_robot_without_a_task_is_refused_by_everything_that_needs_one(monkeypatch):
    monkeypatch.setitem(ROBOTS, "new", replace(PLANAR, name="new"))
    said = "robot 'new' has no task; accepted: a robot that has one: panda, planar; to give it one, write a function in"
    for use in (lambda: reach_task(ROBOTS["new"]), lambda: ReachEnv("new"), lambda: SimParams(robot="new")):
        with pytest.raises(ContractError, match=said):
            use()


def test_every_environment_has_a_robot_with_a_task():
    assert {name: gymnasium.spec(env).kwargs["robot"] for name, env in ENVIRONMENTS.items()} == {
        name: name for name in ENVIRONMENTS
    }
    for name in ENVIRONMENTS:
        assert reach_task(ROBOTS[name]).description.robot == name


CURVE = lemniscate(8, centre=(1.0, 2.0, 3.0), along=(0.0, 0.5, 0.0), across=(0.0, 0.0, 0.5))


def test_eight_points_by_hand():
    # t = 0: cos 1, sin 0; t = pi/4: cos = sin = 1/sqrt 2, so 1 + sin^2 = 3/2; t = pi/2: the double point
    lobe, height = 0.5 * (2**-0.5 / 1.5), 0.5 * (0.5 / 1.5)
    np.testing.assert_allclose(CURVE[0], (1.0, 2.5, 3.0), atol=1e-15)
    np.testing.assert_allclose(CURVE[1], (1.0, 2.0 + lobe, 3.0 + height), atol=1e-15)
    np.testing.assert_allclose(CURVE[2], (1.0, 2.0, 3.0), atol=1e-15)
    np.testing.assert_allclose(CURVE[3], (1.0, 2.0 - lobe, 3.0 - height), atol=1e-15)
    np.testing.assert_allclose(CURVE[4], (1.0, 1.5, 3.0), atol=1e-15)
    np.testing.assert_allclose(CURVE[7], (1.0, 2.0 + lobe, 3.0 - height), atol=1e-15)


def test_every_point_solves_the_implicit_equation():
    # (x^2 + y^2)^2 = a^2 (x^2 - y^2)
    _, x, y = (lemniscate(501, (0, 0, 0), (0, 0.25, 0), (0, 0, 0.25))).T
    np.testing.assert_allclose((x**2 + y**2) ** 2, 0.25**2 * (x**2 - y**2), atol=1e-15)


def test_panda_targets_are_1572_points_across_its_front():
    targets = reach_task(ROBOTS["panda"]).targets
    assert targets.shape == (1572, 3)
    assert (targets[:, 0] == 0.5).all()
    np.testing.assert_allclose(targets[0], (0.5, 0.25, 0.5), atol=1e-15)
    np.testing.assert_allclose(np.abs(targets[:, 2] - 0.5).max(), 0.25 / 8**0.5, atol=1e-6)


def test_planar_targets_lie_in_the_plane_of_its_tip():
    robot = ROBOTS["planar"]
    targets = reach_task(robot).targets
    assert targets.shape == (400, 3)
    assert (targets[:, 2] == robot.chain.position(robot.home)[2]).all()
    np.testing.assert_allclose(targets[0], (0.65, 0.25, 0.1), atol=1e-15)
