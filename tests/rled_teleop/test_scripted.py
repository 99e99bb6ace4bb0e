from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.tick import Tick
from rled_sim.kinematics import Chain
from rled_teleop.operators.imperfection import Hand, Imperfection
from rled_teleop.operators.point_to_point import MAX_IDLE_STEPS
from rled_teleop.operators.scripted import Answer, ScriptedOperator, require_reachable, spread

Curve = Callable[[int], np.ndarray]
History = list[tuple[Tick, Answer]]


def operator(
    task: TaskDescription,
    chain: Chain,
    curve: np.ndarray,
    trajectories: int,
    imperfection: Imperfection | None = None,
    seed: int = 0,
) -> ScriptedOperator:
    hand = Hand(imperfection or Imperfection(), task, np.random.default_rng(seed))
    return ScriptedOperator(task, chain, curve, trajectories, hand)


def drive(arm: Any, person: ScriptedOperator, limit: int = 20_000) -> History:
    history: History = []
    while len(history) < limit:
        tick = arm.tick()
        answer = person.answer(tick)
        history.append((tick, answer))
        if answer.delta is None:
            return history
        arm.apply(answer.delta)
    raise AssertionError(f"not finished after {limit} ticks")


def marks(history: History) -> np.ndarray:
    return np.array([tick.ee.position for tick, answer in history if answer.mark])


def test_every_point_of_the_curve_is_marked_in_order(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    person = operator(task, chain, circle(60), 0)
    history = drive(arm, person)
    np.testing.assert_allclose(marks(history), circle(60), atol=2e-4)
    assert (person.points_marked, person.targets_reached, person.finished) == (60, 0, True)


def test_neighbouring_points_have_neighbouring_joints(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    joints = np.array(
        [tick.joints.position for tick, answer in drive(arm, operator(task, chain, circle(60), 0)) if answer.mark]
    )
    assert np.abs(np.diff(joints, axis=0)).max() < 0.05


def test_a_point_is_marked_within_a_millionth_of_a_radian(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    person = operator(task, chain, circle(20), 0)
    history = drive(arm, person)
    ends = [tick.joints.position + answer.delta.delta for tick, answer in history if answer.delta is not None]
    marked = [tick.joints.position for tick, answer in history if answer.mark]
    for q in marked[1:]:
        assert min(np.abs(end - q).max() for end in ends) <= 1e-6


def test_as_many_targets_are_reached_as_asked_for(task: TaskDescription, chain: Chain, circle: Curve, arm: Any) -> None:
    person = operator(task, chain, circle(60), 12)
    history = drive(arm, person)
    marked = max(index for index, (_, answer) in enumerate(history) if answer.mark)
    assert history[-1][0].status.targets_reached - history[marked][0].status.targets_reached == 12
    assert history[-2][0].status.targets_reached == history[-1][0].status.targets_reached - 1


def test_every_tick_but_the_last_is_answered_with_its_own_stamp(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    history = drive(arm, operator(task, chain, circle(30), 3))
    for tick, answer in history[:-1]:
        assert answer.delta is not None
        assert answer.delta.stamp == tick.stamp
    assert history[-1][1].delta is None


def test_each_trajectory_is_a_straight_joint_line_to_the_marked_point_nearest_to_its_target(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    history = drive(arm, operator(task, chain, circle(60), 10))
    points = np.array([tick.joints.position for tick, answer in history if answer.mark])
    positions = marks(history)
    last_mark = max(index for index, (_, answer) in enumerate(history) if answer.mark)
    for tick, answer in history[last_mark:-1]:
        assert answer.delta is not None
        goal = points[np.linalg.norm(positions - tick.target.position, axis=1).argmin()]
        offset = goal - tick.joints.position
        expected = offset / max(np.abs(offset).max() / task.max_delta, 1.0)
        np.testing.assert_allclose(answer.delta.delta, expected, atol=1e-12)


def test_joints_may_arrive_in_another_order(task: TaskDescription, chain: Chain, circle: Curve, arm: Any) -> None:
    tick = arm.tick()
    swapped = tick._replace(joints=tick.joints.ordered(("elbow", "shoulder")))
    one, other = (operator(task, chain, circle(10), 0).answer(each).delta for each in (tick, swapped))
    assert one is not None
    assert other is not None
    np.testing.assert_array_equal(one.delta, other.delta)


@pytest.mark.parametrize(
    "imperfection",
    [
        Imperfection(tremor=0.1),
        Imperfection(pause_probability=0.1, pause_steps=5.0),
        Imperfection(overshoot=0.2),
        Imperfection(tremor=0.2, pause_probability=0.05, overshoot=0.1),
    ],
)
def test_an_imperfect_operator_marks_and_reaches_all_the_same_and_repeats_with_its_seed(
    task: TaskDescription, chain: Chain, circle: Curve, imperfection: Imperfection, arm: Any
) -> None:
    history = drive(arm, operator(task, chain, circle(40), 5, imperfection, seed=1))
    assert len(marks(history)) == 40
    np.testing.assert_allclose(marks(history), circle(40), atol=0.08)
    again = drive(type(arm)(task, circle(100)), operator(task, chain, circle(40), 5, imperfection, seed=1))
    assert [tick.joints.position.tolist() for tick, _ in history] == [t.joints.position.tolist() for t, _ in again]


def test_overshoot_goes_past_the_goal_and_comes_back(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    start = arm.q
    history = drive(arm, operator(task, chain, circle(1), 0, Imperfection(overshoot=0.2)))
    path = np.array([tick.joints.position for tick, _ in history])
    offset = path[-1] - start
    along = (path - start) @ offset / (offset @ offset)
    assert along.max() == pytest.approx(1.2)
    assert along[-1] == pytest.approx(1.0)


def test_an_episode_that_ends_is_not_answered_and_the_next_one_goes_on(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    person = operator(task, chain, circle(1), 2)
    tick = drive_to_second_phase(arm, person)
    ended = tick._replace(status=replace(tick.status, targets_reached=1, terminated=True))
    assert person.answer(ended) == Answer(None, False)
    assert person.targets_reached == 1
    begun = tick._replace(status=replace(tick.status, episode=1, targets_reached=0))
    assert person.answer(begun).delta is not None
    assert person.targets_reached == 1


def test_a_status_that_lies_counts_as_one_target_at_most(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    person = operator(task, chain, circle(1), 20)
    tick = drive_to_second_phase(arm, person)
    for count, reached in ((0, 0), (10**9, 1), (0, 1)):
        person.answer(tick._replace(status=replace(tick.status, targets_reached=count)))
        assert person.targets_reached == reached


def drive_to_second_phase(arm: Any, person: ScriptedOperator) -> Tick:
    while True:
        tick = arm.tick()
        answer = person.answer(tick)
        if answer.mark:
            return tick._replace(status=replace(tick.status, targets_reached=0))
        assert answer.delta is not None
        arm.apply(answer.delta)


def test_a_robot_that_does_not_move_is_reported(task: TaskDescription, chain: Chain, circle: Curve, arm: Any) -> None:
    person = operator(task, chain, circle(10), 0)
    stuck = arm.tick()
    for _ in range(MAX_IDLE_STEPS + 1):
        person.answer(stuck)
    with pytest.raises(RledError, match="rad from its goal"):
        person.answer(stuck)


def test_a_curve_out_of_reach_is_refused_before_anything_moves(
    task: TaskDescription, chain: Chain, circle: Curve, arm: Any
) -> None:
    with pytest.raises(RledError, match="out of reach"):
        operator(task, chain, circle(10) * 3.0, 0).answer(arm.tick())


def test_points_too_far_apart_for_the_targets_are_refused(task: TaskDescription, circle: Curve) -> None:
    require_reachable(task, circle(60), circle(400))
    with pytest.raises(RledError, match="mark more points"):
        require_reachable(task, circle(4), circle(400))


def test_points_are_spread_evenly_over_the_curve(circle: Curve) -> None:
    np.testing.assert_allclose(spread(circle(400), 40), circle(40), atol=1e-12)
    np.testing.assert_array_equal(spread(circle(400), 400), circle(400))


def test_more_points_than_the_curve_has_are_refused(circle: Curve) -> None:
    with pytest.raises(RledError, match="accepted: 1 to 400"):
        spread(circle(400), 401)
