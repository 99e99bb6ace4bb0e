"""Whatever kills a recorder, what it received until just before stays readable."""

import os
import random
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rled_msgs_py.bags import Bag, BagError, BagWriter, repair
from rled_msgs_py.bags.header import stamp_of
from rled_msgs_py.bags.mcap_journal import journals_of
from rled_msgs_py.bags.mcap_output import Output
from rled_msgs_py.messages import encode
from rled_msgs_py.topics import JOINT_STATES, RECORDED
from rosbags.rosbag2 import Reader

from .samples import PERIOD, descriptions, recording, same, tick

RECORDER = """
import sys
from itertools import count
from pathlib import Path
from tests.rled_msgs_py.samples import tick
from rled_msgs_py.bags import BagWriter, mcap_writer
from rled_msgs_py.messages import encode

mcap_writer.CHUNK_BYTES = 4096
writer = BagWriter(Path(sys.argv[1]), metadata={"seed": "7"})
held = []
for k in count():
    for topic, record in tick(k):
        data = encode(topic, record)
        held.append((topic, data, record.stamp, writer.keep(topic, data, record.stamp)))
    print(k, flush=True)
    while len(held) > 12:
        topic, data, stamp, number = held.pop(0)
        writer.write_cdr(topic, data, stamp, number=number)
"""


def assert_begins_the_recording(bag, count):
    """The bag holds the first ``count`` records of ``recording``, and all readers agree on them."""
    expected = recording(count)[:count]
    assert bag.message_count == count
    for topic in RECORDED:
        mine = [record for name, record in expected if name == topic]
        assert bag.counts[topic.name] == len(mine)
        assert all(map(same, bag.records(topic), mine))
    contents = [("/" + topic.name, encode(topic, record)) for topic, record in expected]
    with (bag.path / f"{bag.path.name}_0.mcap").open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages()
        assert [(each.topic, message.data) for _, each, message in messages] == contents
    with Reader(bag.path) as reader:
        assert [(each.topic, data) for each, _, data in reader.messages()] == contents


@pytest.mark.parametrize("seed", range(4))
def test_a_killed_recorder_loses_nothing_that_it_had_kept(tmp_path, seed):
    path, generator = tmp_path / "bag", random.Random(seed)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [sys.executable, "-c", RECORDER, str(path)], env=environment, stdout=subprocess.PIPE
    ) as child:
        said = [child.stdout.readline() for _ in range(generator.randrange(150, 400))]
        child.send_signal(signal.SIGKILL)
        said += child.stdout.readlines()
    ticks = sum(line.endswith(b"\n") for line in said)
    with pytest.raises(BagError, match=r"no metadata\.yaml.*demos repair "):
        Bag(path)
    assert len(repair(path).lost) <= 1
    bag = Bag(path)
    assert bag.metadata == {"seed": "7"}
    assert [each.stamp for each in bag.ticks()][:ticks] == [k * 20_000_000 for k in range(ticks)]


class Broken:
    """Ends this process at one of its dealings with the disk, a write in the middle of its bytes."""

    def __init__(self, patch, at):
        self._left = at
        write, replace, unlink = Output.write, Path.replace, Path.unlink

        def half(output, data):
            self._count(lambda: os.write(output.fileno(), data[: len(data) // 2]))
            write(output, data)

        patch.setattr(Output, "write", half)
        patch.setattr(Path, "replace", lambda *paths: (self._count(), replace(*paths)))
        patch.setattr(Path, "unlink", lambda path, **options: (self._count(), unlink(path, **options)))

    def _count(self, last_words=lambda: None):
        self._left -= 1
        if not self._left:
            last_words()
            os._exit(9)


def record_until_broken(path, at, said):
    """Record, holding messages back and closing chunks now and then; a byte is said for each message kept."""
    with pytest.MonkeyPatch.context() as patch:
        Broken(patch, at)
        writer, held = BagWriter(path), []
        for topic, record in recording(12):
            data, stamp = encode(topic, record), getattr(record, "stamp", 0)
            held.append((topic, data, stamp, writer.keep(topic, data, stamp)))
            os.write(said, b".")
            if len(held) == 9:
                for topic_, data_, stamp_, number in held[:7]:
                    writer.write_cdr(topic_, data_, stamp_, number=number)
                del held[:7]
                writer.flush()
        for topic, data, stamp, number in held:
            writer.write_cdr(topic, data, stamp, number=number)
        writer.close()


@pytest.mark.parametrize("part", range(2))
def test_wherever_a_recorder_breaks_off_each_kept_message_is_there_once_and_in_order(tmp_path, part):
    for at in range(part + 1, 160, 6):
        path, (heard, said) = tmp_path / str(at) / "bag", os.pipe()
        child = os.fork()
        if not child:
            try:
                record_until_broken(path, at, said)
            finally:
                os._exit(0)
        os.close(said)
        with os.fdopen(heard, "rb") as kept:
            count = len(kept.read())
        _, status = os.waitpid(child, 0)
        if count:
            repair(path)
            bag = Bag(path)
            assert bag.message_count in (count, count + 1)  # the one in progress may be whole
            assert_begins_the_recording(bag, bag.message_count)
            assert not any(map(Path.exists, journals_of(path / "bag_0.mcap")))
    assert os.waitstatus_to_exitcode(status) == 0  # it came to its end


def leave_unfinished(path, entries, are_filed=False):
    """Begin a bag and leave it as a kill would, its messages kept in the journal or filed in a chunk."""
    writer = BagWriter(path, overwrite=True)
    for topic, record in entries:
        if are_filed:
            writer.write(topic, record)
        else:
            writer.keep(topic, encode(topic, record), getattr(record, "stamp", 0))
    writer.flush()
    return path / "bag_0.mcap.journal"


def test_a_flipped_bit_in_a_journal_costs_one_message_and_is_said(tmp_path):
    journal = leave_unfinished(tmp_path / "bag", recording(4))
    data = bytearray(journal.read_bytes())
    data[-30] ^= 1
    journal.write_bytes(data)
    assert len(repair(tmp_path / "bag").lost) == 1
    assert_begins_the_recording(Bag(tmp_path / "bag"), 21)


@pytest.mark.parametrize("content", [b"", b"no journal"])
def test_a_journal_that_is_none_is_said_and_the_file_repaired_without_it(tmp_path, content):
    leave_unfinished(tmp_path / "bag", recording(4), are_filed=True).write_bytes(content)
    assert [len(each) if isinstance(each, list) else each for each in repair(tmp_path / "bag")] == [22, 1, 2]


def test_a_journal_alone_that_is_none_leaves_nothing_to_save(tmp_path):
    leave_unfinished(tmp_path / "bag", recording(4)).write_bytes(b"")
    with pytest.raises(BagError, match=r"nothing in .* can be saved"):
        repair(tmp_path / "bag")


def test_a_bag_may_take_the_place_of_an_unfinished_one(tmp_path):
    leave_unfinished(tmp_path / "bag", recording(4))
    with pytest.raises(BagError, match="exists"):
        BagWriter(tmp_path / "bag")
    leave_unfinished(tmp_path / "bag", recording(1))
    assert repair(tmp_path / "bag").messages == 7


def test_what_was_received_before_the_first_stamp_goes_with_it(tmp_path):
    leave_unfinished(tmp_path / "bag", descriptions() + tick(50) + tick(51))
    repair(tmp_path / "bag")
    times = [each.log_time for each in Bag(tmp_path / "bag").messages()]
    assert times == [50 * PERIOD] * 7 + [51 * PERIOD] * 5


def test_a_simulation_restarted_before_the_kill_keeps_its_order(tmp_path):
    leave_unfinished(tmp_path / "bag", tick(50) + tick(51) + tick(0) + tick(1))
    repair(tmp_path / "bag")
    bag = Bag(tmp_path / "bag")
    assert bag.joints(JOINT_STATES).stamps.tolist() == [50 * PERIOD, 51 * PERIOD, 0, PERIOD]
    assert [each.stamp for each in bag.ticks()] == [50 * PERIOD, 51 * PERIOD, 0, PERIOD]


def test_received_topics_out_of_step_are_put_in_the_order_of_their_stamps(tmp_path):
    late = [entry for k in range(4) for entry in tick(k)[:1]] + [entry for k in range(4) for entry in tick(k)[1:]]
    leave_unfinished(tmp_path / "bag", late)
    repair(tmp_path / "bag")
    found = [stamp_of(each.topic.type, each.data) for each in Bag(tmp_path / "bag").messages()]
    assert found == sorted(found)


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
    assert repair(file.parent) == (safe[-1][1], [], [])
    assert sorted(each.name for each in file.parent.iterdir()) == ["bag_0.mcap", "metadata.yaml"]


def test_what_is_forgotten_is_in_no_journal_after_the_next_chunk(tmp_path):
    writer = BagWriter(tmp_path / "bag")
    numbers = [writer.keep(topic, encode(topic, record), getattr(record, "stamp", 0)) for topic, record in recording(4)]
    writer.forget(numbers[-1])
    topic, record = recording(4)[0]
    writer.write_cdr(topic, encode(topic, record), 0, number=numbers[0])
    writer.flush()
    del writer
    assert repair(tmp_path / "bag").messages == 21
