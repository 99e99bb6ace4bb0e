"""Records of one stamp become one tick, whatever the order of the topics."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.tick import MAX_WAITING, STATE_TOPICS, TickAssembler
from rled_msgs_py.topics import EE_POSE, JOINT_STATES, TARGET_POSE, TASK_STATUS

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
