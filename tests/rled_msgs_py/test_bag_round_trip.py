"""What is written into a bag is read from it, to the last bit."""

import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rled_msgs_py.bags import Bag, BagError, BagWriter
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import encode
from rled_msgs_py.records import PoseSample, Text
from rled_msgs_py.topics import (
    EE_POSE,
    JOINT_DELTA,
    JOINT_STATES,
    MARKED_EE_POSE,
    RECORDED,
    ROBOT_DESCRIPTION,
    SAFETY_GATE,
    TARGET_POSE,
    TASK_DESCRIPTION,
    TASK_STATUS,
)

from .samples import ENTRIES, PERIOD, TASK, TEXTS, URDF, recording, same, tick, write_bag

FLUSH = None


@settings(max_examples=60)
@given(st.lists(st.one_of(ENTRIES, st.just(FLUSH)), min_size=1), st.dictionaries(TEXTS, TEXTS, max_size=3))
def test_any_records_come_back_in_the_order_of_writing(steps, metadata):
    entries = [step for step in steps if step is not FLUSH]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        with BagWriter(path, metadata=metadata) as writer:
            for step in steps:
                writer.flush() if step is FLUSH else writer.write(*step)
        if not entries:
            with pytest.raises(BagError, match="holds no messages"):
                Bag(path)
            return
        bag = Bag(path)
        assert bag.metadata == metadata
        assert bag.message_count == len(entries)
        for topic in {topic for topic, _ in entries}:
            written = [record for name, record in entries if name == topic]
            read = list(bag.records(topic))
            assert len(read) == len(written) == bag.counts[topic.name] == writer.counts[topic.name]
            assert all(map(same, read, written))


@pytest.fixture
def path(tmp_path):
    return write_bag(tmp_path / "bag", ticks=20, metadata={"operator": "scripted", "seed": "7"})


def test_a_bag_describes_itself(path):
    bag = Bag(path)
    assert bag.task == TASK
    assert bag.robot_description == URDF
    assert bag.metadata == {"operator": "scripted", "seed": "7"}
    assert bag.message_count == 2 + 5 * 20
    assert bag.counts["joint_states"] == 20
    assert bag.counts["safety_gate"] == 0


def test_ticks_are_put_together(path):
    ticks = list(Bag(path).ticks())
    assert [each.stamp for each in ticks] == [k * PERIOD for k in range(20)]
    for k, each in enumerate(ticks):
        assert all(same(part, record) for part, (_, record) in zip(each, tick(k), strict=False))


def test_a_tick_of_which_a_topic_is_missing_is_left_out(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(3):
            for topic, record in tick(k):
                if (k, topic) != (1, EE_POSE):
                    writer.write(topic, record)
    assert [each.stamp for each in Bag(tmp_path / "bag").ticks()] == [0, 2 * PERIOD]


def test_the_same_records_make_the_same_files(tmp_path):
    one, two = (write_bag(tmp_path / name / "bag") for name in "ab")
    for name in ("bag_0.mcap", "metadata.yaml"):
        assert (one / name).read_bytes() == (two / name).read_bytes()


def test_a_bare_file_reads_like_its_folder(path):
    folder, bare = Bag(path), Bag(path / "bag_0.mcap")
    assert (bare.task, bare.metadata, bare.counts) == (folder.task, folder.metadata, folder.counts)
    assert all(map(same, bare.records(JOINT_DELTA), folder.records(JOINT_DELTA)))


def test_a_topic_that_was_not_recorded_has_no_records(path):
    bag = Bag(path)
    assert list(bag.records(SAFETY_GATE)) == []
    assert len(bag.poses(MARKED_EE_POSE).stamps) == 0


def test_log_time_never_goes_back_when_a_simulation_restarts(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for _ in range(2):
            for k in range(3):
                for topic, record in tick(k):
                    writer.write(topic, record)
            writer.flush()
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages(log_time_order=False)]
    assert all(before <= after for before, after in pairwise(times))
    bag = Bag(tmp_path / "bag")
    assert [record.stamp for record in bag.records(JOINT_STATES)] == [0, PERIOD, 2 * PERIOD] * 2
    assert [each.stamp for each in bag.ticks()] == [0, PERIOD, 2 * PERIOD] * 2
    assert bag.joints(JOINT_STATES).stamps.tolist() == [0, PERIOD, 2 * PERIOD] * 2


def test_a_message_is_kept_as_it_was_received(tmp_path):
    record = PoseSample(5, "world", np.ones(3))
    data = encode(EE_POSE, record) + b"\x7f\x00"  # what rclpy leaves after a message
    with BagWriter(tmp_path / "bag") as writer:
        writer.write_cdr(EE_POSE, data, 17, 16)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        (message,) = [message for _, _, message in make_reader(file).iter_messages()]
    assert (message.log_time, message.publish_time, message.data) == (17, 16, data)
    assert same(next(Bag(tmp_path / "bag").records(EE_POSE)), record)


def test_a_record_of_another_kind_than_the_topic_is_refused(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        with pytest.raises(ContractError, match="a Text for ee_pose"):
            writer.write(EE_POSE, Text(""))
        writer.write(ROBOT_DESCRIPTION, Text(URDF))
    assert Bag(tmp_path / "bag").counts == {"robot_description": 1}


def test_a_bag_is_completed_when_its_block_ends_in_an_error(tmp_path):
    def fail():
        with BagWriter(tmp_path / "bag") as writer:
            for topic, record in recording(3):
                writer.write(topic, record)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert Bag(tmp_path / "bag").message_count == 2 + 5 * 3


def test_descriptions_said_twice_are_one(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for _ in range(2):
            writer.write(TASK_DESCRIPTION, Text(TASK.to_json()))
    assert Bag(tmp_path / "bag").task == TASK


def test_every_recorded_topic_can_be_read(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for topic, record in recording(1):
            writer.write(topic, record)
    bag = Bag(tmp_path / "bag")
    counts = {topic: len(list(bag.records(topic))) for topic in RECORDED}
    full = {JOINT_STATES, EE_POSE, TARGET_POSE, TASK_STATUS, JOINT_DELTA, ROBOT_DESCRIPTION, TASK_DESCRIPTION}
    assert counts == {topic: int(topic in full) for topic in RECORDED}
