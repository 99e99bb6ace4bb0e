"""Whatever kills a recorder, what it received until just before stays readable."""

import os
import random
import signal
import subprocess
import sys
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rled_msgs_py.bags import FLUSH_PERIOD, Bag, BagError, BagWriter, codec, repair
from rled_msgs_py.topics import JOINT_STATES, RECORDED
from rosbags.rosbag2 import Reader

from .samples import recording, same

RECORDER = """
import sys, time
from itertools import count
from pathlib import Path
from tests.rled_msgs_py.samples import tick
from rled_msgs_py.bags import FLUSH_PERIOD, BagWriter

writer = BagWriter(Path(sys.argv[1]), metadata={"seed": "7"})
flushed = time.monotonic()
for k in count():
    for topic, record in tick(k):
        writer.write(topic, record)
    print(k, time.monotonic(), flush=True)
    if time.monotonic() - flushed >= FLUSH_PERIOD:
        writer.flush()
        flushed = time.monotonic()
    time.sleep(0.0005)
"""


def assert_begins_the_recording(bag, count):
    """The bag holds the first ``count`` records of ``recording``, and all readers agree on them."""
    expected = recording(count)[:count]
    assert bag.message_count == count
    for topic in RECORDED:
        mine = [record for name, record in expected if name == topic]
        assert bag.counts[topic.name] == len(mine)
        assert all(map(same, bag.records(topic), mine))
    contents = [("/" + topic.name, codec.encode(topic, record)) for topic, record in expected]
    with (bag.path / f"{bag.path.name}_0.mcap").open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages()
        assert [(each.topic, message.data) for _, each, message in messages] == contents
    with Reader(bag.path) as reader:
        assert [(each.topic, data) for each, _, data in reader.messages()] == contents


@pytest.mark.parametrize("seed", range(4))
def test_a_killed_recorder_loses_less_than_50_ms(tmp_path, seed):
    path, generator = tmp_path / "bag", random.Random(seed)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [sys.executable, "-c", RECORDER, str(path)], env=environment, stdout=subprocess.PIPE
    ) as child:
        written = [child.stdout.readline() for _ in range(generator.randrange(150, 400))]
        child.send_signal(signal.SIGKILL)
        written += child.stdout.readlines()
    times = [float(line.split()[1]) for line in written if line.endswith(b"\n")]
    with pytest.raises(BagError, match=r"no metadata\.yaml.*repair_bag"):
        Bag(path)
    assert len(repair(path).lost) <= 1
    bag = Bag(path)
    kept = bag.counts[JOINT_STATES.name]
    assert bag.metadata == {"seed": "7"}
    assert [each.stamp for each in bag.ticks()][:kept] == [k * 20_000_000 for k in range(kept)]
    assert kept >= len(times) or times[-1] - times[kept] < 0.05
    assert FLUSH_PERIOD < 0.05


@dataclass(repr=False)
class Unfinished:
    """The bytes of a bag whose recorder never closed it, and how many messages were safe at which size."""

    data: bytes
    safe: list[tuple[int, int]]


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory):
    path, safe = tmp_path_factory.mktemp("unfinished") / "bag", [(0, 0)]
    writer = BagWriter(path)
    file = path / "bag_0.mcap"
    for number, (topic, record) in enumerate(recording(12), 1):
        writer.write(topic, record)
        if number % 7 == 0:
            writer.flush()
            safe.append((file.stat().st_size, number))
    data = file.read_bytes()
    writer.close()
    return Unfinished(data, safe)


@settings(max_examples=50)
@given(share=st.floats(0, 1))
def test_a_bag_that_breaks_off_anywhere_keeps_every_message_that_was_safe(unfinished, tmp_path_factory, share):
    data, safe = unfinished.data, unfinished.safe
    size = int(share * len(data))
    path = tmp_path_factory.mktemp("cut") / "bag"
    path.mkdir()
    (path / "bag_0.mcap").write_bytes(data[:size])
    least = max(count for end, count in safe if end <= size)
    try:
        repair(path)
    except BagError:
        assert not least
        assert (path / "bag_0.mcap").read_bytes() == data[:size]
        return
    bag = Bag(path)
    # a chunk is whole before the indexes are that follow it
    assert bag.message_count in {count for _, count in safe if least <= count <= least + 7}
    assert_begins_the_recording(bag, bag.message_count)


def test_a_repair_that_is_killed_loses_nothing(unfinished, tmp_path):
    data, safe = unfinished.data, unfinished.safe
    (tmp_path / "bag").mkdir()
    file = tmp_path / "bag" / "bag_0.mcap"
    file.write_bytes(data)
    killed = "import os, pathlib; pathlib.Path.replace = lambda *_: os.kill(os.getpid(), 9)\n"
    killed += f"from rled_msgs_py.bags import repair; repair({str(file.parent)!r})"
    assert subprocess.run([sys.executable, "-c", killed], timeout=60, check=False).returncode == -signal.SIGKILL
    assert file.read_bytes() == data
    assert repair(file.parent) == (safe[-1][1], [])
    assert sorted(each.name for each in file.parent.iterdir()) == ["bag_0.mcap", "metadata.yaml"]
