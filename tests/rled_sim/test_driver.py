from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import DeltaCommand, PoseSample
from rled_msgs_py.task_limits import Limits, Zone
from rled_sim.bullet.world import World
from rled_sim.commands import Code, Refused, displacement
from rled_sim.driver import Driver, Rules
from rled_sim.robots import ROBOTS
from rled_sim.simulation import Simulation
from rled_sim.tasks import reach_task

NAMES = ("shoulder", "elbow")
PERIOD = 20_000_000
LOCKSTEP = Rules("lockstep", 100_000_000, auto_reset=True)
REAL_TIME = Rules("real_time", 100_000_000, auto_reset=True)


@pytest.fixture(scope="module")
def world():
    made = World(ROBOTS["planar"], "kinematic", 0.02)
    yield made
    made.close()


def driven(world, rules, seed=1, **limits):
    """A driver that has begun, and its ticks."""
    ticks = []
    task = reach_task(ROBOTS["planar"], **({"max_steps": 0, "targets_per_episode": 0} | limits))
    driver = Driver(Simulation(world, task), rules, seed, ticks.append)
    driver.begin()
    return driver, ticks


def answer(stamp, delta=(0.01, 0.02), names=NAMES):
    return DeltaCommand(stamp, names, np.array(delta))


def code_of(driver, command):
    with pytest.raises(Refused) as caught:
        driver.command(command)
    return caught.value.code


def test_first_tick_is_the_start_at_zero(world):
    _, ticks = driven(world, LOCKSTEP)
    assert len(ticks) == 1
    assert (ticks[0].stamp, ticks[0].status.step, ticks[0].status.episode, ticks[0].status.reward) == (0, 0, 0, 0.0)
    assert tuple(ticks[0].joints.position) == ROBOTS["planar"].home


def test_every_record_of_a_tick_has_its_stamp(world):
    driver, ticks = driven(world, LOCKSTEP)
    driver.command(answer(0))
    assert {record.stamp for record in ticks[1]} == {PERIOD}
    assert {record.frame for record in ticks[1][1:3]} == {"world"}


def test_answer_steps_once(world):
    driver, ticks = driven(world, LOCKSTEP)
    driver.command(answer(0))
    assert len(ticks) == 2
    np.testing.assert_allclose(ticks[1].joints.position, (-0.89, 1.82), atol=1e-15)
    np.testing.assert_allclose(ticks[1].joints.velocity, (0.5, 1.0), atol=1e-9)


def test_reward_of_a_tick_is_that_of_the_transition_to_it(world):
    driver, ticks = driven(world, LOCKSTEP)
    driver.command(answer(0))
    error = ticks[1].ee.position - ticks[0].target.position
    assert ticks[1].status.reward == pytest.approx(-error @ error)


@pytest.mark.parametrize(("stamp", "code"), [(-1, Code.STALE), (1, Code.FUTURE)])
def test_lockstep_takes_only_the_answer_to_its_tick(world, stamp, code):
    driver, ticks = driven(world, LOCKSTEP)
    driver.command(answer(0))
    assert code_of(driver, answer(PERIOD + stamp)) is code
    assert len(ticks) == 2


def test_answer_to_the_last_tick_of_an_episode_is_stale(world):
    driver, ticks = driven(world, LOCKSTEP, max_steps=1)
    driver.command(answer(0))
    assert [tick.status.truncated for tick in ticks] == [False, True, False]
    assert code_of(driver, answer(PERIOD)) is Code.STALE
    driver.command(answer(2 * PERIOD))


def test_without_auto_reset_nothing_follows_until_the_reset(world):
    driver, ticks = driven(world, Rules("lockstep", 0, auto_reset=False), max_steps=1)
    driver.command(answer(0))
    assert code_of(driver, answer(PERIOD)) is Code.EPISODE_OVER
    driver.reset()
    assert [tick.status.episode for tick in ticks] == [0, 0, 1]


def test_real_time_without_a_command_holds_and_does_not_count(world):
    driver, ticks = driven(world, REAL_TIME)
    for _ in range(5):
        driver.timer()
    assert [tick.stamp for tick in ticks] == [k * PERIOD for k in range(6)]
    assert {tick.status.step for tick in ticks} == {0}
    assert {tuple(tick.joints.position) for tick in ticks} == {ROBOTS["planar"].home}


def test_real_time_carries_out_the_newest_command_once(world):
    driver, ticks = driven(world, REAL_TIME)
    driver.timer()
    driver.command(answer(0, (0.05, 0.0)))
    driver.command(answer(PERIOD, (0.01, 0.0)))
    driver.timer()
    driver.timer()
    np.testing.assert_allclose(ticks[2].joints.position, (-0.89, 1.8), atol=1e-15)
    np.testing.assert_array_equal(ticks[3].joints.position, ticks[2].joints.position)
    assert [tick.status.step for tick in ticks] == [0, 0, 1, 1]
    assert ticks[2].status.reward < 0.0
    assert ticks[3].status.reward == 0.0


@pytest.mark.parametrize(("age", "fresh"), [(5, True), (6, False)])
def test_command_is_fresh_for_the_timeout(world, age, fresh):
    driver, _ = driven(world, REAL_TIME)
    for _ in range(age):
        driver.timer()
    if fresh:
        driver.command(answer(0))
    else:
        assert code_of(driver, answer(0)) is Code.STALE


def test_second_answer_to_one_state_is_stale_in_real_time(world):
    driver, _ = driven(world, REAL_TIME)
    driver.command(answer(0))
    driver.timer()
    assert code_of(driver, answer(0, (0.02, 0.01))) is Code.STALE
    assert code_of(driver, answer(2 * PERIOD)) is Code.FUTURE


@pytest.mark.parametrize("rules", [LOCKSTEP, REAL_TIME])
def test_a_command_that_comes_again_is_carried_out_once(world, rules):
    driver, ticks = driven(world, rules)
    for _ in range(3):
        driver.command(answer(0))
    for _ in range(2 if rules is REAL_TIME else 0):
        driver.timer()
        driver.command(answer(0))
    np.testing.assert_allclose(ticks[-1].joints.position, (-0.89, 1.82), atol=1e-15)
    assert ticks[-1].status.step == 1


def test_answer_to_a_state_before_the_reset_is_stale(world):
    driver, _ = driven(world, REAL_TIME)
    driver.timer()
    driver.reset()
    assert code_of(driver, answer(PERIOD)) is Code.STALE
    driver.command(answer(2 * PERIOD))


@pytest.mark.parametrize("rules", [LOCKSTEP, REAL_TIME])
def test_stop_is_latched_and_drops_what_was_pending(world, rules):
    driver, ticks = driven(world, rules)
    driver.pause(True)
    driver.command(answer(0))
    driver.stop(True)
    driver.pause(False)
    driver.timer() if rules is REAL_TIME else None
    assert code_of(driver, answer(driver.stamp)) is Code.STOPPED
    with pytest.raises(RledError, match="emergency stop is on; release it first"):
        driver.reset()
    driver.stop(True)
    driver.stop(False)
    assert tuple(ticks[-1].joints.position) == ROBOTS["planar"].home
    driver.command(answer(driver.stamp))


def test_releasing_a_stop_that_is_not_on_changes_nothing(world):
    driver, ticks = driven(world, LOCKSTEP)
    driver.stop(False)
    assert len(ticks) == 1


def test_paused_time_stands_still(world):
    driver, ticks = driven(world, REAL_TIME)
    driver.pause(True)
    driver.timer()
    assert len(ticks) == 1
    driver.pause(False)
    driver.timer()
    assert len(ticks) == 2


def test_answer_while_paused_is_carried_out_afterwards(world):
    driver, ticks = driven(world, LOCKSTEP)
    driver.pause(True)
    driver.command(answer(0))
    assert len(ticks) == 1
    driver.pause(False)
    assert len(ticks) == 2


def test_seed_begins_the_draws_anew(world):
    driver, ticks = driven(world, LOCKSTEP, seed=4)
    driver.reset()
    driver.reset(4)
    driver.reset()
    targets = [tuple(tick.target.position) for tick in ticks]
    assert targets[:2] == targets[2:]
    assert targets[0] != targets[1]


SLOW = Limits(velocity=(2.0, 2.0))  # 0.04 rad in a period


@pytest.mark.parametrize("rules", [LOCKSTEP, REAL_TIME])
def test_what_a_limit_forbids_is_a_step_without_motion(world, rules):
    driver, ticks = driven(world, rules, limits=SLOW)
    for delta in ((0.05, 0.0), (0.03, 0.0)):
        driver.command(answer(driver.stamp, delta))
        driver.timer() if rules is REAL_TIME else None
    assert [tick.status.refused for tick in ticks] == ["", "velocity", ""]
    assert [tick.status.step for tick in ticks] == [0, 1, 2]
    shoulder = [float(tick.joints.position[0]) for tick in ticks]
    assert shoulder == pytest.approx([-0.9, -0.9, -0.87], abs=1e-15)
    assert ticks[1].status.reward < 0.0


def test_a_hold_and_a_new_episode_are_no_refusals(world):
    driver, ticks = driven(world, REAL_TIME, limits=SLOW)
    driver.command(answer(0, (0.05, 0.0)))
    driver.timer()
    driver.timer()
    driver.command(answer(driver.stamp, (0.05, 0.0)))
    driver.timer()
    driver.reset()
    assert [tick.status.refused for tick in ticks] == ["", "velocity", "", "velocity", ""]


def test_speed_is_lost_in_a_hold(world):
    driver, ticks = driven(world, REAL_TIME, limits=Limits(acceleration=(100.0, 100.0)))  # 0.04 rad more a period
    for delta in (0.04, 0.08, None, 0.08, 0.04):
        if delta is not None:
            driver.command(answer(driver.stamp, (delta, 0.0)))
        driver.timer()
    assert [tick.status.refused for tick in ticks] == ["", "", "", "", "acceleration", ""]


def asked(*point, frame="world"):
    return PoseSample(0, frame, np.array(point))


def test_a_target_is_moved_in_real_time_within_the_plane_and_shown_by_the_next_tick(world):
    driver, ticks = driven(world, REAL_TIME)
    height = ticks[0].target.position[2]
    driver.retarget(asked(0.6, -0.2, 5.0))
    driver.timer()
    np.testing.assert_array_equal(ticks[-1].target.position, [0.6, -0.2, height])


def test_a_target_that_is_moved_onto_the_tool_is_reached_by_the_next_step(world):
    driver, ticks = driven(world, REAL_TIME)
    driver.retarget(asked(*ticks[0].ee.position))
    driver.command(answer(ticks[0].stamp, (0.001, 0.0)))
    driver.timer()
    assert ticks[-1].status.targets_reached == 1


ZONED = Limits(
    tip_lower=(-0.9, -0.9, 0.0), tip_upper=(0.9, 0.9, 1.0), keep_out=(Zone("sphere", (0.6, 0, 0.1), (0.1,)),)
)


@pytest.mark.parametrize(
    ("rules", "limits", "request_", "said"),
    [
        (LOCKSTEP, {}, asked(0.6, 0.1, 0.1), "lockstep"),
        (REAL_TIME, {}, asked(1.06, 0.0, 0.1), "outside the workspace"),
        (REAL_TIME, {}, asked(0.0, -1.06, 0.1), "outside the workspace"),
        (REAL_TIME, {}, asked(0.6, 0.1, 0.1, frame="tool"), "frame 'tool'"),
        (REAL_TIME, {"limits": ZONED}, asked(0.95, 0.0, 0.1), "outside the workspace"),
        (REAL_TIME, {"limits": ZONED}, asked(0.65, 0.0, 0.1), "keep-out sphere"),
    ],
)
def test_a_target_where_the_tool_may_not_go_is_refused_and_stays(world, rules, limits, request_, said):
    driver, ticks = driven(world, rules, **limits)
    with pytest.raises(Refused, match=said) as caught:
        driver.retarget(request_)
    assert caught.value.code is Code.TARGET
    if rules is REAL_TIME:
        driver.timer()
    np.testing.assert_array_equal(ticks[-1].target.position, ticks[0].target.position)


def test_driver_says_when_it_takes_a_command(world):
    taken, task = [], reach_task(ROBOTS["planar"])
    driver = Driver(
        Simulation(world, task), LOCKSTEP, 0, lambda tick: taken.append("tick"), lambda: taken.append("taken")
    )
    driver.begin()
    driver.command(answer(0))
    driver.command(answer(0))
    with pytest.raises(Refused):
        driver.command(answer(0, (0.02, 0.01)))
    assert taken == ["tick", "taken", "tick"]


OPERATIONS = st.sampled_from(["answer", "bad", "timer", "reset", "pause", "go", "stop", "release"])


@given(st.sampled_from([LOCKSTEP, REAL_TIME]), st.lists(OPERATIONS, max_size=40))
def test_stamps_are_whole_periods_and_no_answer_is_carried_out_twice(world, rules, operations):
    driver, ticks = driven(world, rules, max_steps=5)
    taken = set()
    for operation in operations:
        try:
            match operation:
                case "answer":
                    stamp = driver.stamp
                    driver.command(answer(stamp))
                    taken.add(stamp)
                case "bad":
                    driver.command(answer(driver.stamp, (1.0, 1.0)))
                case "timer" if rules is REAL_TIME:
                    driver.timer()
                case "reset":
                    driver.reset()
                case "pause" | "go":
                    driver.pause(operation == "pause")
                case "stop" | "release":
                    driver.stop(operation == "stop")
        except (Refused, RledError):
            pass
    assert [tick.stamp for tick in ticks] == [k * PERIOD for k in range(len(ticks))]
    steps = sum(after.status.step > before.status.step for before, after in pairwise(ticks))
    assert steps <= len(taken)
    assert all(tick.status.step <= 5 for tick in ticks)


def test_largest_displacement_as_a_float32_is_taken():
    # float32(0.1) is a little more than 0.1
    most = float(np.float32(0.1))
    assert displacement(answer(0, (most, -most)), reach_task(ROBOTS["planar"]).description) == [most, -most]


def test_command_in_another_order_is_brought_into_order():
    task = reach_task(ROBOTS["planar"]).description
    assert displacement(answer(0, (0.01, 0.02), ("elbow", "shoulder")), task) == [0.02, 0.01]


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (answer(0, (0.01,), ("elbow",)), Code.WRONG_NAMES),
        (answer(0, (0.01, 0.01, 0.01), ("elbow", "shoulder", "wrist")), Code.WRONG_NAMES),
        (answer(0, (0.1001, 0.0)), Code.TOO_LARGE),
        (answer(0, (0.0, -0.1001)), Code.TOO_LARGE),
    ],
)
def test_command_that_does_not_fit_is_refused(command, code):
    with pytest.raises(Refused) as caught:
        displacement(command, reach_task(ROBOTS["planar"]).description)
    assert caught.value.code is code
