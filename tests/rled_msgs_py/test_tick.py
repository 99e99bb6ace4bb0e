"""Records of one stamp become one tick, whatever the order of the topics and whoever sends joints."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import ContractError
from rled_msgs_py.joint_merger import MAX_AGE
from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.tick import MAX_WAITING, STATE_TOPICS, TickAssembler
from rled_msgs_py.topics import EE_POSE, JOINT_STATES, TARGET_POSE, TASK_STATUS

from rled_msgs_py import messages

TOPICS = [topic.name for topic in STATE_TOPICS]


def record(topic, stamp, run=0):
    """A record of a stamp; ``run`` tells apart the records of a restarted simulation."""
    if topic == JOINT_STATES.name:
        return JointSample(stamp, ("a",), [float(run)], [0.0])
    if topic == TASK_STATUS.name:
        return TaskStatus(stamp, run, 0, 0.0, 0, False, 0, False, False)
    return PoseSample(stamp, "world", np.full(3, float(run)))


def stamps_of(assembler, arrivals):
    ticks = [assembler.add(topic, record(topic, stamp)) for topic, stamp in arrivals]
    return [tick.stamp for tick in ticks if tick is not None]


def runs_of(tick):
    return {int(tick.joints.position[0]), int(tick.ee.position[0]), int(tick.target.position[0]), tick.status.episode}


@st.composite
def arrivals(draw, stamps):
    """Records of all topics in any order that keeps the order within each topic."""
    queues = {topic: list(stamps) for topic in TOPICS}
    order = []
    while any(queues.values()):
        topic = draw(st.sampled_from([topic for topic in TOPICS if queues[topic]]))
        order.append((topic, queues[topic].pop(0)))
    return order


STAMPS = st.lists(st.integers(0, 10**10), min_size=1, max_size=6, unique=True).map(sorted)


@given(STAMPS.flatmap(lambda stamps: st.tuples(st.just(stamps), arrivals(stamps))))
def test_every_tick_is_given_out_once_and_in_order(case):
    stamps, order = case
    assert stamps_of(TickAssembler(), order) == stamps


@given(st.permutations(TOPICS))
def test_a_tick_holds_the_record_of_each_topic(order):
    assembler = TickAssembler()
    ticks = [assembler.add(topic, record(topic, 5)) for topic in order]
    assert ticks[:3] == [None] * 3
    tick = ticks[3]
    assert tick.stamp == tick.joints.stamp == tick.ee.stamp == tick.target.stamp == tick.status.stamp == 5
    assert [type(part) for part in tick] == [JointSample, PoseSample, PoseSample, TaskStatus]


def test_what_is_older_than_the_newest_tick_is_dropped():
    assembler = TickAssembler()
    late = [(TASK_STATUS.name, 1), (TARGET_POSE.name, 1)]
    order = [(JOINT_STATES.name, 1), (EE_POSE.name, 1), *((topic, 2) for topic in TOPICS[:2])]
    order += [(TARGET_POSE.name, 2), (TASK_STATUS.name, 2)]
    assert stamps_of(assembler, order) == [2]
    # these are two parts of a restarted simulation, which complete nothing by themselves
    assert stamps_of(assembler, late) == []


@given(
    st.lists(st.integers(0, 3), min_size=1, max_size=4, unique=True).map(sorted),
    st.lists(st.integers(0, 3), min_size=1, max_size=4, unique=True).map(sorted),
    st.data(),
)
def test_ticks_of_a_restarted_simulation_are_given_out_again(first, second, data):
    assembler = TickAssembler()
    before, after = data.draw(arrivals(first)), data.draw(arrivals(second))
    assert stamps_of(assembler, before) == first
    given_out = stamps_of(assembler, after)
    if second[0] <= first[0]:
        assert given_out == second
    else:  # then some of its stamps look like a continuation
        assert given_out == [stamp for stamp in given_out if stamp in second]


@given(st.data(), st.integers(1, 4), st.integers(0, 3))
def test_a_run_that_broke_off_within_a_tick_does_not_mix_with_the_next(data, ticks, parts):
    assembler = TickAssembler()
    for stamp in range(ticks):
        for topic in TOPICS:
            assembler.add(topic, record(topic, stamp, run=1))
    for topic in data.draw(st.permutations(TOPICS))[:parts]:
        assembler.add(topic, record(topic, ticks, run=1))
    given_out = [
        tick
        for topic, stamp in data.draw(arrivals(range(ticks + 2)))
        if (tick := assembler.add(topic, record(topic, stamp, run=2))) is not None
    ]
    assert [tick.stamp for tick in given_out] == list(range(ticks + 2))
    assert [runs_of(tick) for tick in given_out] == [{2}] * (ticks + 2)


def test_a_restart_at_the_tick_that_was_waiting_is_a_new_tick():
    assembler = TickAssembler()
    order = [(topic, 0) for topic in TOPICS]
    assert stamps_of(assembler, order) == [0]
    assert stamps_of(assembler, order) == [0]


def test_a_missing_topic_does_not_fill_the_memory():
    assembler = TickAssembler()
    for stamp in range(10 * MAX_WAITING):
        assembler.add(JOINT_STATES.name, record(JOINT_STATES.name, stamp))
    assert len(assembler._parts) <= MAX_WAITING


# Joint samples as robots send them, put together to ticks: grippers, two publishers, joints that nobody knows.


ARM = ("left", "right")
NAN = float("nan")


def joints(stamp, **position):
    values = list(position.values())
    return JOINT_STATES.name, JointSample(stamp, tuple(position), values, [0.0] * len(values))


def rest(stamp):
    pose = PoseSample(stamp, "world", np.zeros(3))
    status = TaskStatus(stamp, 0, 0, 0.0, 0, False, 0, False, False)
    return [(EE_POSE.name, pose), (TARGET_POSE.name, pose), (TASK_STATUS.name, status)]


def ticks_of(arrivals, assembler=None):
    assembler = assembler or TickAssembler(ARM)
    found = [assembler.add(topic, record) for topic, record in arrivals]
    return [(tick.stamp, *tick.joints.ordered(ARM).position.tolist()) for tick in found if tick is not None]


def test_joints_that_are_not_the_tasks_are_passed_over():
    assembler = TickAssembler(ARM)
    tick = [assembler.add(*each) for each in [joints(5, finger=NAN, right=2.0, left=1.0), *rest(5)]][-1]
    assert (tick.joints.names, tick.joints.position.tolist()) == (ARM, [1.0, 2.0])


def test_messages_of_other_joints_only_neither_complete_nor_disturb_a_tick():
    gripper = joints(3, finger=0.5)
    assert ticks_of([gripper, joints(5, left=1.0, right=2.0), gripper, *rest(5), joints(4, finger=0.1)]) == [(5, 1, 2)]


@given(st.permutations([joints(5, left=1.0), joints(5, right=2.0), *rest(5)]))
def test_halves_of_one_stamp_are_one_tick_in_any_order(arrivals):
    assert ticks_of(arrivals) == [(5, 1.0, 2.0)]


def test_a_half_of_the_same_stamp_is_waited_for():
    first = [joints(0, left=1.0), joints(0, right=2.0), *rest(0)]
    assert ticks_of([*first, joints(20, left=3.0), *rest(20), joints(20, right=4.0)]) == [(0, 1, 2), (20, 3, 4)]


def test_halves_with_stamps_of_their_own_are_put_together_at_the_tick():
    arrivals = []
    for k in range(5):
        arrivals += [joints(20 * k, left=float(k)), *rest(20 * k), joints(20 * k + 3, right=10.0 + k)]
    # the first right arm comes after the first tick; from then on the newest one stands in
    assert ticks_of(arrivals) == [(0, 0, 10), (20, 1, 10), (40, 2, 11), (60, 3, 12), (80, 4, 13)]


def test_a_half_that_is_too_old_does_not_stand_in():
    arrivals = [joints(0, left=0.0), *rest(0), joints(3, right=1.0)]
    late = MAX_AGE + 4
    assert ticks_of([*arrivals, joints(late, left=1.0), *rest(late)]) == [(0, 0, 1)]


def test_a_joint_in_use_that_is_not_known_costs_its_tick_and_is_named():
    for bad in [NAN, float("inf"), -float("inf")]:
        assembler = TickAssembler(ARM)
        with pytest.raises(ContractError, match="joint state of 20 ns: right is at"):
            ticks_of([joints(0, left=1.0, right=2.0), *rest(0), joints(20, left=1.0, right=bad)], assembler)
        assert ticks_of([*rest(20), joints(40, left=3.0, right=4.0), *rest(40)], assembler) == [(40, 3, 4)]


def test_half_a_robot_that_is_not_known_costs_its_tick():
    arrivals = [joints(0, left=1.0), joints(0, right=NAN), *rest(0), joints(20, left=1.0), joints(20, right=5.0)]
    assert ticks_of([*arrivals, *rest(20)]) == [(20, 1, 5)]


def test_the_order_of_the_joints_may_change_from_message_to_message():
    arrivals = [joints(0, left=1.0, right=2.0), *rest(0), joints(20, right=4.0, left=3.0), *rest(20)]
    assert ticks_of(arrivals) == [(0, 1, 2), (20, 3, 4)]


def test_halves_of_a_restarted_simulation_do_not_mix_with_the_old_ones():
    first = [each for k in (7, 8) for each in (joints(k, left=1.0), joints(k, right=1.0), *rest(k))]
    second = [each for k in (0, 1) for each in (joints(k, left=2.0), joints(k, right=2.0), *rest(k))]
    assert ticks_of(first + second) == [(7, 1, 1), (8, 1, 1), (0, 2, 2), (1, 2, 2)]


def test_before_the_robot_is_known_a_sample_is_taken_as_it_is():
    assembler = TickAssembler()
    assert [assembler.add(*each) for each in [joints(0, a=1.0), *rest(0)]][-1].joints.names == ("a",)
    assembler.meet(ARM)
    assert ticks_of([joints(20, left=1.0, right=2.0, a=3.0), *rest(20)], assembler) == [(20, 1, 2)]


def test_rates_and_efforts_are_taken_as_they_come():
    for effort in [[], [NAN], [1.0, 2.0, 3.0]]:
        for velocity, known in [
            ([], [0.0, 0.0]),
            ([0.5], [0.5, NAN]),
            ([NAN, 0.5], [NAN, 0.5]),
            ([0.5, 1.0, 2.0], [0.5, 1.0]),
        ]:
            from rled_msgs_py.ros.convert import from_msg
            from sensor_msgs.msg import JointState

            message = JointState(name=ARM, position=[1.0, 2.0], velocity=velocity, effort=effort)
            sample = from_msg(JOINT_STATES, message)
            assert sample.ordered(ARM).position.tolist() == [1.0, 2.0]
            np.testing.assert_array_equal(sample.velocity, known)
            assert messages.decode(JOINT_STATES, messages.encode(JOINT_STATES, sample)).names == ARM
