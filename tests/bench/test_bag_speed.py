"""Speed of reading a bag into arrays, against rosbags decoding messages one by one."""

import os
import time
from itertools import islice
from pathlib import Path
from statistics import median

import numpy as np
import pytest
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.bags.header import moved
from rled_msgs_py.messages import encode
from rled_msgs_py.records import JointSample
from rled_msgs_py.topics import JOINT_STATES
from rosbags.highlevel import AnyReader

from .conftest import wanted

MESSAGES = 1_000_000
PART = 30_000
"""Messages that rosbags decodes; its rate does not depend on their number."""
ROUNDS = 3
NAMES = tuple(f"panda_joint{k}" for k in range(1, 8))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A million joint states of seven joints at 1 kHz, in chunks as a recorder writes them."""
    path = tmp_path_factory.mktemp("bench") / "bag"
    q = np.linspace(0.0, 1.0, 7)
    template = encode(JOINT_STATES, JointSample(0, NAMES, q, q))
    place = template.rindex(q.tobytes())  # of the velocities
    noise = np.random.default_rng(0).normal(size=(1000, 7))
    with BagWriter(path) as bag:
        for k in range(MESSAGES):
            stamp = k * 1_000_000
            data = moved(JOINT_STATES.name, JOINT_STATES.type, template, stamp)
            bag.write_cdr(JOINT_STATES, data[:place] + noise[k % 1000].tobytes() + data[place + q.nbytes :], stamp)
    return path


def ours(path: Path) -> float:
    begin = time.perf_counter()
    table = Bag(path).joints(JOINT_STATES)
    seconds = time.perf_counter() - begin
    assert table.position.shape == table.velocity.shape == (MESSAGES, 7)
    assert table.stamps[-1] == (MESSAGES - 1) * 1_000_000
    return MESSAGES / seconds


def theirs(path: Path) -> float:
    with AnyReader([path]) as reader:
        messages = reader.messages()
        begin = time.perf_counter()
        for connection, _, data in islice(messages, PART):
            reader.deserialize(data, connection.msgtype)
        return PART / (time.perf_counter() - begin)


def test_a_million_joint_states_are_read_five_times_as_fast_as_rosbags_decodes_them(recording, figure):
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        rates = [(ours(recording), theirs(recording)) for _ in range(ROUNDS)]  # in turns: the same load for both
    finally:
        os.sched_setaffinity(0, cores)
    ratio = median(mine / peer for mine, peer in rates)
    figure("bag_messages_per_s", round(median(mine for mine, _ in rates)))
    figure("rosbags_messages_per_s", round(median(peer for _, peer in rates)))
    figure("bag_read_vs_rosbags", round(ratio, 1))
    wanted(ratio >= 5.0, "bag_read_vs_rosbags of 5 or more")
