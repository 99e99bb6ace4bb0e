"""Permission, deadman and what the operator is told, with a clock that stands still."""

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import RledError
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task
from rled_teleop.operators.jog import Jog
from rled_teleop.web.control import DRIVER_TIMEOUT, Control
from rled_teleop.web.jog_command import Follow, Move, Turn
from rled_teleop.web.set_point import SetPoint, SetPointSlot
from rled_teleop.web.steering import delta, steer

ROBOT = ROBOTS["planar"]
TASK = reach_task(ROBOT).description
JOG = Jog(TASK, ROBOT.chain)
HOME = np.array(ROBOT.home)


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


class Room:
    """The page's control, and the operator at the other end of the slot."""

    def __init__(self, clock: Clock) -> None:
        self._clock, slot = clock, SetPointSlot()
        self.control = Control(0.5, slot.put, clock)
        self._received = SetPointSlot(slot.file)

    def displacement(self) -> np.ndarray | None:
        return steer(self._received.newest(), JOG, HOME, self._clock.now)

    def moves(self) -> bool:
        wanted = self.displacement()
        return wanted is not None and bool(wanted.any())


@pytest.fixture
def room(clock: Clock) -> Room:
    return Room(clock)


@pytest.fixture
def control(room: Room) -> Control:
    return room.control


def test_first_visitor_drives_and_the_second_watches(room: Room, control: Control) -> None:
    control.arrive(1)
    control.arrive(2)
    control.command(2, Move((1.0, 0.0, 0.0)))
    assert not room.moves()
    control.command(1, Move((1.0, 0.0, 0.0)))
    assert room.moves()


def test_a_wish_ends_when_it_is_not_renewed(room: Room, control: Control, clock: Clock) -> None:
    control.arrive(1)
    control.command(1, Move((1.0, 0.0, 0.0)))
    clock.now += 0.49
    assert room.moves()
    clock.now += 0.01
    assert room.displacement() is None


def test_a_held_pointer_keeps_the_wish_and_an_idle_one_does_not(room: Room, control: Control, clock: Clock) -> None:
    control.arrive(1)
    control.command(1, Move((1.0, 0.0, 0.0)))
    for _ in range(10):
        clock.now += 0.3
        control.hear(1, holds=True)
        assert room.moves()
    clock.now += 0.3
    control.hear(1, holds=False)
    clock.now += 0.3
    assert not room.moves()


def test_a_wish_that_has_ended_is_not_brought_back_by_a_late_sign_of_life(
    room: Room, control: Control, clock: Clock
) -> None:
    control.arrive(1)
    control.command(1, Move((1.0, 0.0, 0.0)))
    clock.now += 0.6
    assert not room.moves()
    control.hear(1, holds=True)
    assert not room.moves()


@pytest.mark.parametrize(
    "end", [Control.release, Control.leave, Control.let_go, lambda control, visitor: control.stop()]
)
def test_releasing_leaving_letting_go_and_the_stop_end_the_wish_at_once(
    room: Room, control: Control, end: object
) -> None:
    control.arrive(1)
    control.command(1, Move((1.0, 0.0, 0.0)))
    end(control, 1)  # type: ignore[operator]
    assert room.displacement() is None


def test_another_visitor_takes_over_only_from_nobody_or_from_the_silent(
    room: Room, control: Control, clock: Clock
) -> None:
    control.arrive(1)
    control.arrive(2)
    assert not control.take(2)
    control.let_go(1)
    assert control.take(2)
    assert not control.take(1)
    clock.now += DRIVER_TIMEOUT
    assert not control.take(1)
    clock.now += 0.1
    control.command(2, Move((1.0, 0.0, 0.0)), lasts=60.0)  # it speaks again
    assert not control.take(1)
    clock.now += DRIVER_TIMEOUT + 0.1
    assert control.take(1)
    assert not room.moves()


def test_nobody_drives_in_the_place_of_who_left_without_asking(control: Control) -> None:
    control.arrive(1)
    control.arrive(2)
    control.leave(1)
    assert not control.drives(2)
    assert control.take(2)


def test_whoever_has_left_cannot_take(control: Control) -> None:
    control.arrive(1)
    control.leave(1)
    assert not control.take(1)


def test_every_visitor_may_stop_and_only_the_driver_may_release(control: Control) -> None:
    control.arrive(1)
    control.arrive(2)
    control.stop()
    control.ask(2, "release")
    assert control.requests.take() == {"estop": None}
    control.ask(1, "release")
    assert control.requests.take() == {"release": None}


def test_a_flood_of_requests_is_one(control: Control) -> None:
    control.arrive(1)
    for value in range(10_000):
        control.ask(1, "threshold", float(value))
    assert control.requests.take() == {"threshold": 9999.0}
    assert control.requests.take() == {}


def test_taken_over_the_robot_holds_where_nothing_is_wished(room: Room, control: Control) -> None:
    control.arrive(1)
    control.switch_taken(2)
    assert room.displacement() is None
    control.switch_taken(1)
    wanted = room.displacement()
    assert wanted is not None
    assert not wanted.any()


@given(st.lists(st.tuples(st.sampled_from(["arrive", "leave", "let_go", "take"]), st.integers(0, 3)), max_size=40))
def test_the_driver_is_always_one_of_those_who_are_there(steps: list[tuple[str, int]]) -> None:
    control, present = Control(0.5, lambda set_point: None, Clock()), set[int]()
    for what, visitor in steps:
        if what == "arrive" and visitor in present:
            continue
        getattr(control, what)(visitor)
        if what in ("arrive", "leave"):
            (present.add if what == "arrive" else present.discard)(visitor)
        assert control.visitors.driver in {None, *present}
        assert control.visitors.count == len(present)


def test_following_ends_at_the_goal_and_never_exceeds_the_speed() -> None:
    q, goal = HOME.copy(), (0.55, 0.2, 0.7)
    for _ in range(300):
        step = delta(Follow(goal), JOG, q, 0.4)
        assert np.abs(step).max() <= 0.4 * TASK.max_delta + 1e-12
        before, q = ROBOT.chain.position(q), q + step
        assert np.linalg.norm(ROBOT.chain.position(q) - before) <= 0.5 * 0.4 * 0.02 * 1.1
    assert ROBOT.chain.position(q)[:2] == pytest.approx(goal[:2], abs=1e-3)
    assert not delta(Follow(goal), JOG, q, 0.4).any()


def test_turning_moves_one_joint_to_its_angle() -> None:
    q = HOME.copy()
    for _ in range(60):
        q = q + delta(Turn(1, 1.0), JOG, q, 0.5)
    assert q == pytest.approx([HOME[0], 1.0])


@given(st.floats(-10.0, 10.0))
def test_turning_stays_within_the_limits(goal: float) -> None:
    q = HOME.copy()
    for _ in range(200):
        q = q + delta(Turn(0, goal), JOG, q, 1.0)
        assert TASK.joint_lower[0] <= q[0] <= TASK.joint_upper[0]


@given(
    st.one_of(
        st.none(),
        st.builds(Follow, st.tuples(*3 * [st.floats(-2.0, 2.0)])),
        st.builds(Move, st.tuples(*3 * [st.floats(-1.0, 1.0)])),
        st.builds(Turn, st.integers(0, 6), st.floats(-3.0, 3.0)),
    ),
    st.floats(0.0, 1e9),
    st.floats(0.01, 1.0),
    st.booleans(),
    st.booleans(),
)
def test_an_order_arrives_as_it_was_given(command, until: float, share: float, taken: bool, beside: bool) -> None:
    set_point, slot = SetPoint(command, until, share, taken, beside), SetPointSlot()
    slot.put(set_point)
    assert SetPointSlot(slot.file).newest() == set_point


def test_an_order_that_is_half_written_is_not_taken() -> None:
    slot = SetPointSlot()
    operator = SetPointSlot(slot.file)
    first, second = SetPoint(Move((1.0, 0.0, 0.0)), 5.0), SetPoint(None, 7.0, taken=True)
    slot.put(first)
    whole = os.pread(slot.file, 1000, 0)
    assert operator.newest() == first
    slot.put(second)
    os.pwrite(slot.file, whole[:20], 0)
    assert operator.newest() == first
    slot.put(second)
    assert operator.newest() == second


def test_a_file_that_holds_no_orders_is_refused() -> None:
    for file in [-1, 987]:
        with pytest.raises(RledError, match=f"open file {file} holds no set points; accepted: .*; start"):
            SetPointSlot(file)
