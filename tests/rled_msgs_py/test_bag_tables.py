"""Many messages are read as arrays, equal to the records one by one, and fast."""

import time
from functools import partial

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rled_msgs_py.bags import Bag, BagError, BagWriter
from rled_msgs_py.errors import ContractError
from rled_msgs_py.records import DeltaCommand, JointSample, PoseSample
from rled_msgs_py.topics import EE_POSE, JOINT_DELTA, JOINT_STATES
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rled_msgs_py import messages, topics

from .samples import FINITE, NAMES, PERIOD, STAMPS, orientations, tick, vectors, write_bag


def write(path, topic, records):
    with BagWriter(path) as writer:
        for number, record in enumerate(records):
            data = record if isinstance(record, bytes) else messages.encode(topic, record)
            writer.write_cdr(topic, data, number)
            if number % 7 == 6:
                writer.flush()
    return Bag(path)


def assert_joints_equal(bag, topic):
    records, table = list(bag.records(topic)), bag.joints(topic)
    assert table.stamps.tolist() == [record.stamp for record in records]
    assert {record.names for record in records} == {table.names}
    for name in ("position", "velocity"):
        rows = np.array([getattr(record, name) for record in records])
        assert (getattr(table, name).shape, getattr(table, name).tobytes()) == (rows.shape, rows.tobytes())


NAME_CHOICES = st.sampled_from([("a",), ("shoulder", "elbow"), ("j1", "j22", "j333"), ("ä", "ab", "abc", "abcd")])


@st.composite
def joint_runs(draw):
    names = draw(NAME_CHOICES)
    size = len(names)
    make = st.builds(JointSample, STAMPS, st.just(names), vectors(size), vectors(size))
    return draw(st.lists(make, min_size=1, max_size=20))


@settings(max_examples=50)
@given(joint_runs())
def test_joint_tables_equal_the_records(tmp_path_factory, records):
    assert_joints_equal(write(tmp_path_factory.mktemp("b") / "bag", JOINT_STATES, records), JOINT_STATES)


@settings(max_examples=50)
@given(st.lists(st.builds(PoseSample, STAMPS, st.just("world"), vectors(3), orientations()), min_size=1, max_size=20))
def test_pose_tables_equal_the_records(tmp_path_factory, records):
    table = write(tmp_path_factory.mktemp("b") / "bag", EE_POSE, records).poses(EE_POSE)
    assert table.stamps.tolist() == [record.stamp for record in records]
    assert table.frame == "world"
    assert table.position.tobytes() == np.array([record.position for record in records]).tobytes()
    assert table.orientation.tobytes() == np.array([record.orientation for record in records]).tobytes()


def test_displacements_have_no_velocity(tmp_path):
    table = write(tmp_path / "bag", JOINT_DELTA, [tick(k)[4][1] for k in range(30)]).joints(JOINT_DELTA)
    assert table.names == NAMES
    assert table.position.tolist() == [[0.01, -0.001]] * 30
    assert table.velocity.tolist() == [[0.0, 0.0]] * 30


def test_tables_of_a_topic_that_was_not_recorded_are_empty(tmp_path):
    bag = Bag(write_bag(tmp_path / "bag"))
    joints, poses = bag.joints(topics.MARKED_JOINT_STATES), bag.poses(topics.MARKED_EE_POSE)
    assert (joints.stamps.shape, joints.names, joints.position.shape) == ((0,), (), (0, 0))
    assert (poses.stamps.shape, poses.frame, poses.position.shape) == ((0,), "", (0, 3))
    assert joints.stamps.dtype == poses.stamps.dtype == np.int64


def test_joints_can_be_brought_into_another_order(tmp_path):
    table = write(tmp_path / "bag", JOINT_STATES, [JointSample(1, NAMES, [1.0, 2.0], [3.0, 4.0])]).joints(JOINT_STATES)
    other = table.ordered(("elbow", "shoulder"))
    assert (other.position.tolist(), other.velocity.tolist()) == ([[2.0, 1.0]], [[4.0, 3.0]])
    with pytest.raises(ContractError, match="wrist"):
        table.ordered(("elbow", "wrist"))


def samples(count):
    return [JointSample(k * PERIOD, NAMES, [k, -k], [0.5, k]) for k in range(count)]


ODD = {
    "velocity left out": lambda record: message(record, velocity=np.empty(0)),
    "an effort": lambda record: message(record, effort=np.ones(2)),
    "a frame": lambda record: message(record, frame="base"),
    "big endian": lambda record: message(record, little_endian=False),
    "bytes after it": lambda record: messages.encode(JOINT_STATES, record) + bytes(8),
    "padding that is not zero": lambda record: messages.encode(JOINT_STATES, record).replace(
        b"\0\0\0\0\2", b"\0abc\2", 1
    ),
}


def message(record, frame="", little_endian=True, **fields):
    store = get_typestore(Stores.ROS2_JAZZY)
    found = store.deserialize_cdr(messages.encode(JOINT_STATES, record), JOINT_STATES.type)
    found.header.frame_id = frame
    for name, value in fields.items():
        setattr(found, name, value)
    return bytes(store.serialize_cdr(found, JOINT_STATES.type, little_endian=little_endian))


@pytest.mark.parametrize("odd", ODD.values(), ids=ODD.keys())
def test_messages_of_another_layout_are_read_all_the_same(tmp_path, odd):
    for number, places in enumerate([{0}, {13}, set(range(20)), {3, 19}]):
        records = [odd(record) if k in places else record for k, record in enumerate(samples(20))]
        bag = write(tmp_path / f"bag_{number}", JOINT_STATES, records)
        assert_joints_equal(bag, JOINT_STATES)
        assert bag.joints(JOINT_STATES).position.tolist() == [[k, -k] for k in range(20)]


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    names=st.sampled_from([("elbow", "shoulder"), ("shoulder", "wrist"), ("shoulder",), ("a", "b", "c")]),
    places=st.sets(st.integers(0, 19), min_size=1),
    run_bytes=st.sampled_from([300, 1 << 20]),
)
def test_other_names_midway_have_columns_of_their_own(tmp_path_factory, monkeypatch, names, places, run_bytes):
    monkeypatch.setattr("rled_msgs_py.bags.mcap_file.RUN_BYTES", run_bytes)
    records = samples(20)
    for place in places:
        values = np.arange(len(names)) + place / 100.0
        records[place] = JointSample(place * PERIOD, names, values, -values)
    table = write(tmp_path_factory.mktemp("names") / "bag", JOINT_STATES, records).joints(JOINT_STATES)
    assert table.names == tuple(dict.fromkeys(name for record in records for name in record.names))
    assert table.stamps.tolist() == [k * PERIOD for k in range(20)]
    for row, record in enumerate(records):
        columns = [table.names.index(name) for name in record.names]
        assert table.position[row, columns].tolist() == record.position.tolist()
        assert table.velocity[row, columns].tolist() == record.velocity.tolist()
        assert np.flatnonzero(table.named[row]).tolist() == sorted(columns)
        assert np.isnan(np.delete(table.position[row], columns)).all()


def test_the_messages_of_two_publishers_are_read_as_fast_as_those_of_one(tmp_path):
    arm = samples(20_000)
    both = [each for k, record in enumerate(arm) for each in (record, JointSample(k * PERIOD, ("finger",), [k], [0.0]))]
    one, two = (write(tmp_path / name, JOINT_STATES, found) for name, found in (("one", arm), ("two", both)))
    (alone, _), (beside, table) = (processor_time(partial(bag.joints, JOINT_STATES)) for bag in (one, two))
    assert table.ordered(NAMES).position.tolist() == [record.position.tolist() for record in arm]
    assert beside < 10.0 * alone + 0.5  # one by one it takes a hundred times as long


def test_many_runs_equal_one(tmp_path, monkeypatch):
    bag = write(tmp_path / "bag", JOINT_STATES, samples(50))
    whole = bag.joints(JOINT_STATES)
    monkeypatch.setattr("rled_msgs_py.bags.mcap_file.RUN_BYTES", 300)
    parts = bag.joints(JOINT_STATES)
    assert all(np.array_equal(one, other) for one, other in zip(whole, parts, strict=True))


def test_another_frame_midway_is_refused_naming_the_message(tmp_path):
    records = [PoseSample(k, "world" if k != 5 else "base", np.zeros(3)) for k in range(9)]
    bag = write(tmp_path / "bag", EE_POSE, records)
    with pytest.raises(BagError, match=r"message 5 of ee_pose .* has the frame base; accepted: world in every message"):
        bag.poses(EE_POSE)


def spoiled(topic, record, value, by):
    data = messages.encode(topic, record)
    assert data.count(np.float64(value).tobytes()) == 1
    return data.replace(np.float64(value).tobytes(), np.float64(by).tobytes())


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
@pytest.mark.parametrize("place", [0, 13])
@pytest.mark.parametrize("topic", [JOINT_DELTA, EE_POSE], ids=lambda topic: topic.name)
def test_a_message_that_is_not_finite_is_refused_naming_it(tmp_path, bad, place, topic):
    make = {
        JOINT_DELTA: lambda k: DeltaCommand(k, NAMES, [0.125, k]),
        EE_POSE: lambda k: PoseSample(k, "world", [0.125, k, k]),
    }[topic]
    records = [spoiled(topic, make(k), 0.125, bad) if k == place else make(k) for k in range(20)]
    bag = write(tmp_path / "bag", topic, records)
    for read in (lambda: list(bag.records(topic)), lambda: (bag.poses if topic == EE_POSE else bag.joints)(topic)):
        with pytest.raises(BagError, match=f"bag: message {place} of {topic.name}: (position|delta) holds"):
            read()


@pytest.mark.parametrize("place", [0, 13])
def test_a_joint_that_is_not_known_is_left_out_where_it_is_used(tmp_path, place):
    records = samples(20)
    records[place] = JointSample(place * PERIOD, NAMES, [float("nan"), place], [float("nan"), 0.0])
    table = write(tmp_path / "bag", JOINT_STATES, records).joints(JOINT_STATES)
    assert len(table.stamps) == 20
    assert table.ordered(("elbow", "shoulder")).stamps.tolist() == [k * PERIOD for k in range(20) if k != place]


def test_a_quaternion_that_is_no_rotation_is_refused_naming_the_message(tmp_path):
    records = [PoseSample(k, "world", np.zeros(3)) for k in range(9)]
    records[4] = spoiled(EE_POSE, records[4], 1.0, 1.5)
    with pytest.raises(BagError, match="message 4 of ee_pose: orientation"):
        write(tmp_path / "bag", EE_POSE, records).poses(EE_POSE)


def test_a_stamp_before_zero_is_refused_naming_the_message(tmp_path):
    records = [messages.encode(JOINT_STATES, record) for record in samples(9)]
    records[4] = records[4][:4] + b"\xff\xff\xff\xff" + records[4][8:]
    with pytest.raises(BagError, match="message 4 of joint_states: stamp of -1 s"):
        write(tmp_path / "bag", JOINT_STATES, records).joints(JOINT_STATES)


@given(st.lists(st.tuples(FINITE, FINITE), min_size=1, max_size=5))
def test_a_table_holds_copies(tmp_path_factory, values):
    records = [JointSample(k, NAMES, pair, pair) for k, pair in enumerate(values)]
    bag = write(tmp_path_factory.mktemp("b") / "bag", JOINT_STATES, records)
    bag.joints(JOINT_STATES).position[:] = 0.0
    assert bag.joints(JOINT_STATES).position.tolist() == [list(pair) for pair in values]


def processor_time(read):
    begin = time.process_time()
    result = read()
    return time.process_time() - begin, result


# alone on a machine it is 7 and 11 times: a chunk of two ticks, as in real time, costs more than its messages
@pytest.mark.parametrize(("flush_every", "least"), [(2, 3), (50, 5)], ids=["small chunks", "chunks as of lockstep"])
def test_reading_as_arrays_is_many_times_faster_than_rosbags(tmp_path, flush_every, least):
    path = write_bag(tmp_path / "bag", ticks=3000, flush_every=flush_every)

    def theirs():
        with AnyReader([path]) as reader:
            wanted = [each for each in reader.connections if each.topic == "/joint_states"]
            return [reader.deserialize(data, each.msgtype).position for each, _, data in reader.messages(wanted)]

    slow, fast = np.inf, np.inf
    for _ in range(5):  # in turn, so that what else runs on the machine slows both down
        (slow_now, positions), (fast_now, table) = (
            processor_time(read) for read in (theirs, lambda: Bag(path).joints(JOINT_STATES))
        )
        slow, fast = min(slow, slow_now), min(fast, fast_now)
    assert np.array_equal(table.position, positions)
    print(f"rosbags {slow / 3000 * 1e6:.1f} us a message, here {fast / 3000 * 1e6:.1f} us")
    assert slow / fast > least
