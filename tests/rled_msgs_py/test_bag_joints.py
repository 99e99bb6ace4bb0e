"""Bags of what robots really send on ``joint_states``: what is used is judged, what is not is passed over."""

import numpy as np
import pytest
from rled_msgs_py.bags import Bag, BagWriter, review
from rled_msgs_py.bags.faults import INVALID, RENAMED, TWO_PUBLISHERS
from rled_msgs_py.messages import encode
from rled_msgs_py.records import JointSample

from rled_msgs_py import topics

from .samples import NAMES, PERIOD, descriptions, tick

TICKS = 60
NAN = float("nan")


def sample(k, names=NAMES, position=None, velocity=None, stamp=None):
    q = tick(k)[0][1].position if position is None else position
    rates = np.zeros(len(names)) if velocity is None else velocity
    return topics.JOINT_STATES, JointSample(k * PERIOD if stamp is None else stamp, names, q, rates)


def written(path, states_of):
    """A bag in which ``states_of`` says what is on ``joint_states`` at a tick."""
    with BagWriter(path) as bag:
        for topic, record in descriptions():
            bag.write(topic, record)
        for k in range(TICKS):
            for topic, record in [*states_of(k), *tick(k)[1:]]:
                bag.write(topic, record)
    return Bag(path)


def q(k):
    return tick(k)[0][1].position


def with_gripper(k):
    return [sample(k, ("finger", *NAMES), [NAN, *q(k)], [NAN, NAN, NAN])]


VARIANTS = {
    "a gripper in all messages": with_gripper,
    "a gripper in some messages": lambda k: with_gripper(k) if k % 3 == 0 else [sample(k)],
    "a gripper in the first message only": lambda k: with_gripper(k) if k == 0 else [sample(k)],
    "an order that changes": lambda k: [sample(k, NAMES[::-1], q(k)[::-1])] if k % 2 else [sample(k)],
    "rates that nobody knows": lambda k: [sample(k, velocity=[NAN, NAN])],
    "rates that are not known now and then": lambda k: [sample(k, velocity=[NAN if k % 7 == 0 else 1.0, 2.0])],
    "a gripper with a publisher of its own": lambda k: [sample(k), sample(k, ("finger",), [0.1])],
    "a gripper whose stamps are its own": lambda k: [sample(k), sample(k, ("finger",), [NAN], stamp=k * PERIOD + 7)],
    "a gripper that is faster": lambda k: (
        [sample(k)]
        + [sample(k, ("finger", "thumb"), [0.1, 0.2], stamp=k * PERIOD + part * PERIOD // 4) for part in range(1, 4)]
    ),
    "two halves": lambda k: [sample(k, (name,), [angle]) for name, angle in zip(NAMES, q(k), strict=True)],
    "two halves in turns of order": lambda k: [
        sample(k, (NAMES[place],), [q(k)[place]]) for place in ((0, 1) if k % 2 else (1, 0))
    ],
    "two halves and a gripper": lambda k: [
        sample(k, ("shoulder", "finger"), [q(k)[0], NAN]),
        sample(k, ("elbow",), [q(k)[1]]),
    ],
}


@pytest.mark.parametrize("states_of", VARIANTS.values(), ids=VARIANTS.keys())
def test_the_states_are_those_of_the_robot_and_no_fault_is_found(tmp_path, states_of):
    bag = written(tmp_path / "bag", states_of)
    found = review(bag)
    assert found.faults == []
    assert found.timeline.moments.tolist() == [k * PERIOD for k in range(TICKS)]
    np.testing.assert_array_equal(found.timeline.q, [q(k) for k in range(TICKS)])
    assert [each.stamp for each in bag.ticks()] == found.timeline.moments.tolist()
    np.testing.assert_array_equal([each.joints.position for each in bag.ticks()], found.timeline.q)


def test_halves_with_stamps_of_their_own_are_put_together_at_the_ticks(tmp_path):
    def states_of(k):
        late = sample(k, ("elbow",), [q(k)[1]], stamp=k * PERIOD + 3_000_000)
        return [sample(k, ("shoulder",), [q(k)[0]]), late]

    found = review(written(tmp_path / "bag", states_of))
    assert found.faults == []
    assert found.timeline.moments.tolist() == [
        k * PERIOD for k in range(1, TICKS)
    ]  # at the first there is no elbow yet
    np.testing.assert_array_equal(found.timeline.q, [[q(k)[0], q(k - 1)[1]] for k in range(1, TICKS)])


def test_a_half_that_stops_is_missing_as_soon_as_it_is_too_old(tmp_path):
    def states_of(k):
        late = [sample(k, ("elbow",), [q(k)[1]], stamp=k * PERIOD + 3_000_000)] if k < 40 else []
        return [sample(k, ("shoulder",), [q(k)[0]]), *late]

    found = review(written(tmp_path / "bag", states_of))
    assert found.timeline.moments.tolist() == [k * PERIOD for k in range(1, 45)]  # 0.1 s after 39 ticks and 3 ms
    (fault,) = found.faults
    assert (fault.kind, fault.first) == (RENAMED, 45 * PERIOD)
    assert fault.what == "message 85 is of shoulder: it lacks elbow (and 14 more)"


@pytest.mark.parametrize("bad", [NAN, float("inf")])
@pytest.mark.parametrize("place", [0, 1, 30, TICKS - 1])
def test_a_joint_in_use_that_is_not_known_costs_its_moment(tmp_path, bad, place):
    found = review(written(tmp_path / "bag", lambda k: [sample(k, position=[0.1, bad] if k == place else None)]))
    (fault,) = found.faults
    assert (fault.kind, fault.topics) == (INVALID, ("joint_states",))
    assert (fault.first, fault.last) == (place * PERIOD, place * PERIOD)
    assert fault.what == f"message {place} is not valid: elbow is at {bad}"
    assert len(found.timeline.moments) == TICKS - 1


def test_faults_far_from_each_other_are_told_apart(tmp_path):
    found = review(written(tmp_path / "bag", lambda k: [sample(k, position=[NAN, 0.0] if k in (5, 6, 50) else None)]))
    assert [(fault.first // PERIOD, fault.last // PERIOD) for fault in found.faults] == [(5, 6), (50, 50)]
    assert len(found.timeline.moments) == TICKS - 3


def test_a_half_that_is_not_known_costs_its_moment(tmp_path):
    bag = written(
        tmp_path / "bag", lambda k: [sample(k, ("shoulder",), [0.1]), sample(k, ("elbow",), [NAN if k == 9 else 0.2])]
    )
    found = review(bag)
    assert [fault.kind for fault in found.faults] == [INVALID]
    assert len(found.timeline.moments) == TICKS - 1


def test_one_joint_from_two_publishers_is_found_in_halves_too(tmp_path):
    def states_of(k):
        return [sample(k, NAMES), sample(k, ("elbow", "finger"), [q(k)[1] + 0.5, 0.0])]

    assert TWO_PUBLISHERS in {fault.kind for fault in review(written(tmp_path / "bag", states_of)).faults}


def test_a_message_that_cannot_be_read_costs_its_moment(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as bag:
        for topic, record in [*descriptions(), *(each for k in range(TICKS) for each in tick(k))]:
            data = encode(topic, record)
            is_cut = topic == topics.JOINT_STATES and record.stamp == 20 * PERIOD
            bag.write_cdr(topic, data[:40] if is_cut else data, getattr(record, "stamp", 0))
    found = review(Bag(path))
    (fault,) = found.faults
    assert (fault.kind, fault.first) == (INVALID, 20 * PERIOD)
    assert len(found.timeline.moments) == TICKS - 1


def test_a_robot_that_lacks_a_joint_altogether_is_refused(tmp_path):
    from rled_msgs_py.bags.timeline import read_timeline
    from rled_msgs_py.errors import ContractError

    bag = written(tmp_path / "bag", lambda k: [sample(k, ("shoulder", "wrist"), [0.1, 0.2])])
    with pytest.raises(ContractError, match="joint_states names shoulder, wrist; accepted: shoulder, elbow"):
        read_timeline(bag)
