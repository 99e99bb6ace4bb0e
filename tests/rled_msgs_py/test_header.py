import numpy as np
import pytest
from rled_msgs_py.bags import Bag, BagWriter, merge
from rled_msgs_py.bags.header import moved, sim_stamp
from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import LATEST, encode
from rled_msgs_py.records import JointSample
from rled_msgs_py.topics import JOINT_STATES

from .samples import NAMES, recording, write_bag


def sample(stamp):
    return JointSample(stamp, NAMES, np.zeros(2), np.zeros(2))


def test_a_stamp_moves_as_far_as_a_message_can_tell():
    for stamp, shift in [(0, LATEST - 1), (LATEST - 1, 0), (LATEST - 1, 1 - LATEST), (0, -LATEST)]:
        data = encode(JOINT_STATES, sample(stamp))
        later = moved(JOINT_STATES.name, JOINT_STATES.type, data, shift)
        assert sim_stamp(JOINT_STATES.name, JOINT_STATES.type, later) == stamp + shift


def test_a_stamp_that_no_message_can_tell_is_refused():
    for stamp, shift in [(0, LATEST), (LATEST - 1, 1), (0, -LATEST - 1)]:
        data = encode(JOINT_STATES, sample(stamp))
        with pytest.raises(ContractError, match=r"a stamp on joint_states of \d+ ns, to be moved by"):
            moved(JOINT_STATES.name, JOINT_STATES.type, data, shift)


def test_a_recording_behind_one_that_ends_at_the_last_stamp_is_refused(tmp_path):
    with BagWriter(tmp_path / "late") as bag:
        for topic, record in recording(2):
            bag.write(topic, record)
        bag.write(JOINT_STATES, sample(LATEST - 1))
    other = write_bag(tmp_path / "other", ticks=3)
    with pytest.raises(ContractError, match="to be moved by"):
        merge([Bag(tmp_path / "late"), Bag(other)], tmp_path / "merged", lambda _: None)
    assert not (tmp_path / "merged").exists()
