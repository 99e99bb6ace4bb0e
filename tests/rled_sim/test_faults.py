"""Each fault by hand on a line, then the same line in the environments and in the driver."""

from dataclasses import fields

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import ContractError, RledError
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample, TaskStatus
from rled_msgs_py.tick import Tick
from rled_sim.bullet.world import World
from rled_sim.driver import Driver, Rules
from rled_sim.fault_channel import FaultChannel
from rled_sim.faults import NO_FAULTS, Faults
from rled_sim.faulty_env import FaultyReach
from rled_sim.robots import ROBOTS
from rled_sim.simulation import Simulation
from rled_sim.tasks import reach_task

import rled_sim  # noqa: F401

PLANAR = ROBOTS["planar"]
TASK = reach_task(PLANAR).description
PERIOD = TASK.period
EVERYTHING = Faults(
    observation_delay=1,
    observation_delay_spread=2,
    control_delay=1,
    control_delay_spread=3,
    reward_delay=2,
    reward_delay_spread=3,
    sensor_noise=0.01,
    actuator_noise=0.2,
    observation_loss=0.2,
    command_loss=0.2,
    command_repeat=0.2,
    hidden="elbow target",
)


def channel(seed=0, **faults):
    made = FaultChannel(Faults(**faults), TASK, PLANAR.chain.position)
    made.seed(seed)
    made.begin()
    return made


def tick(k, reward=0.0, end=False):
    """A tick whose first joint angle is k hundredths."""
    stamp, q = k * PERIOD, np.array([0.01 * k, 1.0])
    return Tick(
        JointSample(stamp, TASK.joint_names, q, np.ones(2)),
        PoseSample(stamp, "world", PLANAR.chain.position(q)),
        PoseSample(stamp, "world", np.array([0.7, 0.01 * k, 0.1])),
        TaskStatus(stamp, 0, k, reward, 0, False, 0, end, False),
    )


def seen(made, count):
    """Which state is seen at each tick."""
    return [round(100 * float(made.see(tick(k)).joints.position[0])) for k in range(count)]


def carried(made, count):
    """Which command is carried out in each step, None where none is."""
    arrived = [made.act([0.01 * k, 0.0]) for k in range(count)]
    return [None if each is None else round(100 * each[0]) for each in arrived]


def test_a_line_without_faults_gives_back_what_it_is_given():
    made, delta, state = channel(), [0.01, 0.02], tick(3)
    before = made._rng.bit_generator.state
    assert made.act(delta) is delta
    assert made.see(state) is state
    assert made.act(None) is None
    assert made._rng.bit_generator.state == before


def test_a_late_state_has_the_newest_stamp():
    made = channel(observation_delay=2)
    assert seen(made, 6) == [0, 0, 0, 1, 2, 3]
    late = made.see(tick(6))
    assert late.stamp == 6 * PERIOD
    assert {record.stamp for record in late} == {6 * PERIOD}
    assert late.status.step == 6  # how far the episode has come is told at once
    assert late.target.position[1] == pytest.approx(0.04)


def test_a_late_displacement_is_carried_out_once():
    assert carried(channel(control_delay=2), 5) == [None, None, 0, 1, 2]


def test_of_displacements_that_arrive_together_the_newest_is_carried_out():
    made = channel(control_delay=1, control_delay_spread=4)
    numbers = [each for each in carried(made, 300) if each is not None]
    assert numbers == sorted(set(numbers))
    assert len(numbers) < 250


def test_a_state_is_never_older_than_one_seen_before():
    made = channel(observation_delay=1, observation_delay_spread=4)
    numbers = seen(made, 300)
    assert numbers == sorted(numbers)
    ages = {k - number for k, number in enumerate(numbers) if k > 10}
    assert ages == {1, 2, 3, 4, 5}


@given(st.integers(0, 20), st.integers(0, 20), st.lists(st.integers(-5, 5), min_size=1, max_size=60))
def test_late_rewards_are_paid_in_full_and_not_early(delay, spread, rewards):
    made = channel(reward_delay=delay, reward_delay_spread=spread)
    paid = [made.see(tick(k, float(reward), k == len(rewards) - 1)).status.reward for k, reward in enumerate(rewards)]
    assert sum(paid) == sum(rewards)
    if len(rewards) > 1:
        assert paid[: min(delay, len(rewards) - 1)] == [0.0] * min(delay, len(rewards) - 1)


def test_a_constant_delay_of_rewards_moves_them():
    made = channel(reward_delay=2)
    assert [made.see(tick(k, float(k))).status.reward for k in range(5)] == [0.0, 0.0, 0.0, 1.0, 2.0]


def test_noisy_joints_have_the_deviation_asked_for_and_their_tip():
    made = channel(sensor_noise=0.01)
    states = [made.see(tick(50)) for _ in range(2000)]
    angles = np.array([state.joints.position for state in states])
    np.testing.assert_allclose(angles.mean(axis=0), (0.5, 1.0), atol=1e-3)
    np.testing.assert_allclose(angles.std(axis=0), 0.01, rtol=0.06)
    np.testing.assert_allclose(
        [state.ee.position for state in states], PLANAR.chain.position(angles), rtol=0, atol=1e-14
    )


def test_noisy_joints_stay_within_their_range():
    angles = [channel(seed, sensor_noise=1.0).see(tick(0)).joints.position for seed in range(200)]
    assert np.min(angles, axis=0)[1] == 0.0  # the elbow's lower limit


def test_noise_of_the_actuators_is_in_units_of_the_largest_displacement():
    made = channel(actuator_noise=0.5)
    deltas = np.array([made.act([0.02, -0.02]) for _ in range(2000)])
    np.testing.assert_allclose(deltas.mean(axis=0), (0.02, -0.02), atol=4e-3)
    np.testing.assert_allclose(deltas.std(axis=0), 0.05, rtol=0.06)


def test_a_lost_state_shows_the_one_before():
    numbers = seen(channel(observation_loss=0.5), 1000)
    kept = sum(number == k for k, number in enumerate(numbers))
    assert numbers == sorted(numbers)
    assert 430 < kept < 570
    assert seen(channel(observation_loss=1.0), 4) == [0, 0, 0, 0]


def test_a_lost_displacement_is_none():
    numbers = carried(channel(command_loss=0.3), 1000)
    assert 630 < sum(each is not None for each in numbers) < 770
    assert all(each in (None, k) for k, each in enumerate(numbers))


def test_a_repeated_displacement_stands_in_for_the_next():
    assert carried(channel(command_repeat=1.0), 4) == [0, 0, 0, 0]
    numbers = carried(channel(command_repeat=0.3), 1000)
    assert 230 < sum(each != k for k, each in enumerate(numbers)) < 370


def test_what_is_hidden_is_in_the_middle_of_its_range():
    state = channel(hidden="elbow ee target").see(tick(7))
    np.testing.assert_array_equal(state.joints.position, (0.07, 1.5))  # elbow: 0 to 3 rad
    np.testing.assert_array_equal(state.joints.velocity, (1.0, 0.0))
    np.testing.assert_allclose(state.ee.position, (0.0, 0.0, 0.1))
    np.testing.assert_allclose(state.target.position, (0.0, 0.0, 0.1))


def test_a_new_episode_forgets_what_was_under_way():
    made = channel(control_delay=1, observation_delay=1, reward_delay=1)
    made.act([0.05, 0.0])
    made.see(tick(1, reward=1.0))
    made.begin()
    assert made.act([0.01, 0.0]) is None
    state = made.see(tick(9))
    assert state.joints.position[0] == pytest.approx(0.09)
    assert state.status.reward == 0.0


def test_other_faults_forget_what_was_under_way_and_equal_ones_do_not():
    made = channel(control_delay=1)
    assert made.act([0.05, 0.0]) is None
    made.configure(Faults(control_delay=1))
    assert made.act([0.01, 0.0]) == [0.05, 0.0]
    made.configure(NO_FAULTS)
    assert made.act([0.02, 0.0]) == [0.02, 0.0]
    made.configure(Faults(control_delay=1))
    assert made.act([0.03, 0.0]) is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"observation_delay": -1}, "observation_delay is -1; accepted: 0 to 1000"),
        ({"command_loss": 1.5}, "command_loss is 1.5; accepted: 0.0 to 1.0"),
        ({"sensor_noise": float("nan")}, "sensor_noise nan"),
        ({"control_delay": 1.5}, "control_delay 1.5; accepted: a whole number"),
    ],
)
def test_faults_out_of_range_are_refused(given, said):
    with pytest.raises(ContractError, match=said):
        Faults(**given)


def test_what_cannot_be_hidden_is_refused():
    with pytest.raises(ContractError, match="hidden is 'wrist'; accepted: shoulder, elbow, ee, target"):
        channel(hidden="elbow wrist")


def drive(env, seed, steps=60):
    """Observations, rewards and ends of random actions."""
    rng, track = np.random.default_rng(seed), [env.reset(seed=seed)[0].tobytes()]
    while len(track) < steps:
        action = (rng.uniform(-1, 1, env.action_space.shape) * env.action_space.high).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        track.append((observation.tobytes(), reward, terminated, truncated, info))
        if terminated or truncated:
            track.append(env.reset()[0].tobytes())
    return track


@pytest.fixture
def make():
    opened = []

    def opener(name="rled/PlanarReach-v0", **options):
        opened.append(gymnasium.make(name, **{"max_steps": 25} | options))
        return opened[-1]

    yield opener
    for env in opened:
        env.close()


@pytest.mark.parametrize("name", ["rled/PandaReach-v0", "rled/PlanarReach-v0"])
def test_a_wrapper_without_faults_changes_no_bit(make, name):
    env = make(name)
    assert drive(FaultyReach(env, NO_FAULTS), 3) == drive(env, 3)


@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version")
def test_an_environment_with_faults_passes_the_checker_and_repeats_itself(make):
    env = make(faults=EVERYTHING)
    check_env(env, skip_render_check=True)
    assert drive(env, 5) == drive(env, 5) == drive(make(faults=EVERYTHING), 5)
    assert drive(env, 5) != drive(env, 6)


@pytest.mark.parametrize("name", [each.name for each in fields(Faults)])
def test_each_fault_changes_what_is_seen(make, name):
    value = {"hidden": "target"}.get(name, 2 if "delay" in name else 0.3)
    faulty, sound = drive(make(faults=Faults(**{name: value})), 1), drive(make(), 1)
    assert faulty != sound


def test_faults_of_another_environment_are_refused():
    with pytest.raises(RledError, match="one of this project's environments"):
        FaultyReach(gymnasium.make("Pendulum-v1"), EVERYTHING)


@pytest.fixture(scope="module")
def world():
    made = World(PLANAR, "kinematic", 0.02)
    yield made
    made.close()


class TestDriver:
    def driven(self, world, mode="lockstep", auto_reset=True, **faults):
        ticks, task = [], reach_task(PLANAR, max_steps=5, targets_per_episode=0)
        rules = Rules(mode, 100_000_000, auto_reset)
        driver = Driver(Simulation(world, task), rules, 0, ticks.append, faults=Faults(**faults))
        driver.begin()
        return driver, ticks

    def test_lockstep_goes_on_when_everything_is_lost(self, world):
        driver, ticks = self.driven(world, command_loss=1.0, observation_loss=1.0)
        for _ in range(12):
            driver.command(DeltaCommand(driver.stamp, TASK.joint_names, np.array([0.1, 0.1])))
        assert {tuple(each.joints.position) for each in ticks} == {PLANAR.home}
        assert [each.status.step for each in ticks] == [0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5, 0, 1, 2]

    def test_real_time_carries_a_late_command_out_between_others(self, world):
        driver, ticks = self.driven(world, "real_time", control_delay=2)
        driver.command(DeltaCommand(0, TASK.joint_names, np.array([0.1, 0.0])))
        for _ in range(5):
            driver.timer()
        assert [float(each.joints.position[0]) for each in ticks] == pytest.approx([-0.9] * 3 + [-0.8] * 3)
        assert [each.status.step for each in ticks] == [0, 0, 0, 1, 1, 1]

    def test_no_late_command_survives_a_stop_or_the_end_of_an_episode(self, world):
        driver, ticks = self.driven(world, "real_time", auto_reset=False, control_delay=2)
        driver.command(DeltaCommand(0, TASK.joint_names, np.array([0.1, 0.0])))
        driver.stop(True)
        driver.stop(False)
        for _ in range(4):
            driver.timer()
        assert {tuple(each.joints.position) for each in ticks} == {PLANAR.home}
        for _ in range(12):
            if not driver._simulation.episode.over:
                driver.command(DeltaCommand(driver.stamp, TASK.joint_names, np.array([0.01, 0.0])))
            driver.timer()
        assert ticks[-1].status.step == 5
        assert ticks[-1].joints.position[0] == pytest.approx(-0.85)
