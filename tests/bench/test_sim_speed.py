"""Speed of the environment and of the batch kinematics, on one core."""

import os
import time
from statistics import median

import gymnasium
import numpy as np
import pytest
from rled_sim.robots import ROBOTS
from rled_sim.vector.reach import ReachBatch

import rled_sim  # noqa: F401

from .conftest import wanted

ROUNDS = 7


@pytest.fixture(autouse=True)
def one_core():
    """Stay on one core, so that a library with threads gains nothing by them."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    yield
    os.sched_setaffinity(0, cores)


def steps_per_second(env, actions):
    begin = time.perf_counter()
    for action in actions:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return len(actions) / (time.perf_counter() - begin)


def opened(name):
    env = gymnasium.make(name)
    env.reset(seed=0)
    env.action_space.seed(0)
    return env


def test_environment_is_forty_times_as_fast_as_panda_gyms_joint_reach(figure):
    import panda_gym  # noqa: F401

    ours, theirs = opened("rled/PandaReach-v0"), opened("PandaReachJoints-v3")
    many, few = ([env.action_space.sample() for _ in range(count)] for env, count in ((ours, 10_000), (theirs, 300)))
    rates, ratios = [], []
    for _ in range(ROUNDS):  # taking turns, so that both meet the same load of the machine
        rates.append((steps_per_second(ours, many), steps_per_second(theirs, few)))
        ratios.append(rates[-1][0] / rates[-1][1])
    ours.close()
    theirs.close()
    figure("env_steps_per_s", round(median(mine for mine, _ in rates)))
    figure("panda_gym_steps_per_s", round(median(peer for _, peer in rates)))
    figure("env_vs_panda_gym", round(median(ratios), 1))
    wanted(median(ratios) >= 40.0, "env_vs_panda_gym of 40 or more")


def batch_steps_per_second(batch, actions):
    begin = time.perf_counter()
    for action in actions:
        step = batch.step(action)
        if (over := step.terminated | step.truncated).any():
            batch.begin(over)
    return batch.num_envs * len(actions) / (time.perf_counter() - begin)


def test_a_batch_of_1024_is_ten_times_as_fast_as_single_environments(figure):
    single, batch = opened("rled/PandaReach-v0"), ReachBatch("panda", 1024)
    batch.begin()
    few = [single.action_space.sample() for _ in range(5000)]
    many = np.random.default_rng(0).uniform(-0.04, 0.04, (300, 1024, 7)).astype(np.float32)
    rates = [(batch_steps_per_second(batch, many), steps_per_second(single, few)) for _ in range(ROUNDS)]
    single.close()
    ratio = median(ours / theirs for ours, theirs in rates)
    figure("batch_steps_per_s", round(median(ours for ours, _ in rates)))
    figure("batch_vs_single_env", round(ratio, 1))
    wanted(ratio >= 10.0, "batch_vs_single_env of 10 or more")


def test_batch_kinematics_make_three_million_configurations_a_second(figure):
    robot = ROBOTS["panda"]
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (200_000, 7))
    robot.chain.position(q)
    rates = []
    for _ in range(3 * ROUNDS):
        begin = time.perf_counter()
        robot.chain.position(q)
        rates.append(len(q) / (time.perf_counter() - begin))
    figure("fk_per_s", round(median(rates)))
    wanted(median(rates) >= 3e6, "fk_per_s of 3 million or more")
