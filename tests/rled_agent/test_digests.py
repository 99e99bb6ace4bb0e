"""What an input holds decides its digest, not where it lies or how it is packed."""

import hashlib
import shutil
from pathlib import Path

import pytest
from rled_agent.training.digests import bag_digest, file_digest
from rled_msgs_py.bags import Bag, BagWriter
from rled_msgs_py.errors import RledError
from rled_msgs_py.topics import DIAGNOSTICS, JOINT_DELTA, MARKED_JOINT_STATES, RECORDED

TOPICS = {topic.name: topic for topic in RECORDED}


def rewritten(source: Bag, path: Path, change=lambda name, data: data, order=lambda messages: messages) -> Bag:
    """The messages of a bag in a new one, in another order or with other content; None leaves one out."""
    with BagWriter(path) as writer:
        for each in order(list(source.messages())):
            name = source.name_of(each)
            data = change(name, each.data)
            if data is not None:
                writer.write_cdr(TOPICS[name], data, each.log_time)
    return Bag(path)


def test_a_file_has_the_sha_256_of_its_bytes(tmp_path):
    (tmp_path / "a").write_bytes(b"weights")
    assert file_digest(tmp_path / "a") == hashlib.sha256(b"weights").hexdigest()
    for path in (tmp_path, tmp_path / "gone"):
        with pytest.raises(RledError, match=f"can't read {path}"):
            file_digest(path)


def test_a_copy_the_bare_file_and_a_bag_written_anew_have_one_digest(planar_bag, tmp_path):
    bag = Bag(planar_bag)
    copied = shutil.copytree(planar_bag, tmp_path / "copied")
    (mcap,) = copied.glob("*.mcap")
    (copied / "metadata.yaml").rename(tmp_path / "metadata.yaml")
    anew = rewritten(bag, tmp_path / "anew")
    swapped = rewritten(bag, tmp_path / "swapped", order=lambda messages: [messages[1], messages[0], *messages[2:]])
    assert {bag_digest(each) for each in (bag, Bag(mcap), anew, swapped)} == {bag_digest(bag)}


def test_every_message_counts(planar_bag, tmp_path):
    bag, seen = Bag(planar_bag), 0

    def last_byte(name: str, data: bytes) -> bytes:
        nonlocal seen
        seen += name == MARKED_JOINT_STATES.name
        return data[:-1] + bytes([data[-1] ^ 1]) if name == MARKED_JOINT_STATES.name and seen == 7 else data

    others = [
        rewritten(bag, tmp_path / "changed", last_byte),
        rewritten(bag, tmp_path / "fewer", lambda name, data: None if name == JOINT_DELTA.name else data),
    ]
    assert len({bag_digest(each) for each in (bag, *others)}) == 3


def test_what_lies_beside_the_demonstration_does_not_count(planar_bag, tmp_path):
    bag = Bag(planar_bag)
    (message, *_) = bag.messages()
    with BagWriter(tmp_path / "more") as writer:
        for each in bag.messages():
            writer.write_cdr(TOPICS[bag.name_of(each)], each.data, each.log_time)
        writer.write_cdr(DIAGNOSTICS, message.data, message.log_time)
    assert bag_digest(Bag(tmp_path / "more")) == bag_digest(bag)
