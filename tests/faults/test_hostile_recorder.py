"""Hostile messages and requests for record_demos while it records: its bag stays whole."""

import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rled_msgs_py.bags import Bag
from rled_msgs_py.processes import program
from rled_msgs_py.topics import (
    CLOCK_TOPIC,
    DIAGNOSTICS,
    EPISODE_EVENTS,
    MARKED_EE_POSE,
    MARKED_JOINT_STATES,
    MARKERS,
    RECORDED,
    SAFETY_GATE,
)
from rled_teleop.recording.message_filter import MessageFilter
from rled_teleop.recording.params import RecordParams
from std_srvs.srv import SetBool, Trigger

from .hostile_requests import requests_of
from .plant import Peer, Plant
from .siege import COUNT, Rogue, besiege, require_all, volleys

EXTRA = (MARKERS, DIAGNOSTICS, CLOCK_TOPIC)
TOPICS = (*(topic for topic in RECORDED if topic is not EPISODE_EVENTS), *EXTRA)
VOLLEYS = volleys(TOPICS)
SERVICES = {"record": SetBool, "keep": Trigger, "discard": Trigger, "mark_pose": Trigger}
REQUESTS = requests_of(RecordParams, SERVICES)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hostile") / "bag"


@pytest.fixture(scope="module")
def recorder(ros_domain: int, bag: Path) -> Iterator[Peer]:
    """It records a robot that an operator swings."""
    endless = ["--targets-per-episode", "0", "--max-steps", "0", "--mode", "real_time"]
    with Plant("--robot", "planar", *endless) as plant:
        plant.children.start([sys.executable, str(Path(__file__).with_name("operator_that_swings.py"))])
        command = [*program("rled_teleop", "record_demos"), "--output", str(bag)]
        command += ["--topics", ",".join(topic.name for topic in EXTRA)]
        recorder = Peer(plant, "record_demos", plant.children.start(command, echo=False))
        plant.wait(lambda: bool(plant.node.count_publishers(EPISODE_EVENTS.name)), "the recorder")
        restore(recorder)
        yield recorder


def restore(recorder: Peer) -> None:
    """An episode is being recorded."""

    def begins() -> bool:
        return "is being recorded" in recorder.call(SetBool, "record", data=True).message

    recorder.plant.wait(begins, "an episode")


def test_nothing_is_left_out(recorder: Peer) -> None:
    with Rogue(recorder) as rogue:
        for topic in TOPICS:
            rogue.fire((0, [(topic, b"")]))  # it listens to some topics only when somebody speaks there
        require_all(recorder, TOPICS, REQUESTS)


@pytest.mark.parametrize("name", VOLLEYS)
def test_messages_do_no_harm(recorder: Peer, name: str) -> None:
    with Rogue(recorder) as rogue:
        besiege(recorder, VOLLEYS[name], rogue.fire)
    restore(recorder)


@pytest.mark.parametrize("name", REQUESTS)
def test_requests_do_no_harm(recorder: Peer, name: str) -> None:
    besiege(recorder, REQUESTS[name].requests, lambda request: recorder.call(REQUESTS[name].kind, name, request))
    restore(recorder)


def test_the_bag_is_whole(recorder: Peer, bag: Path) -> None:
    """Stands last: the recorder ends. It keeps every message that it received, whatever it says, and nothing else."""
    recorder.child.process.send_signal(signal.SIGINT)
    recorder.plant.wait(lambda: recorder.child.exit_code is not None, "its end")
    said = list(recorder.child.last_lines)
    assert not [line for line in said if "Traceback" in line]
    assert recorder.child.exit_code in (0, 2), said
    whole = Bag(bag)
    assert len(list(whole.messages())) == whole.message_count
    readable = MessageFilter(str)
    known = {topic.name: topic for topic in TOPICS}
    kept = [(known[name], each.data) for each in whole.messages() if (name := whole.name_of(each)) in known]
    assert all(readable.accepts(topic, data) for topic, data in kept)
    for topic in (SAFETY_GATE, MARKED_JOINT_STATES, MARKED_EE_POSE):  # nobody else speaks there; a part is garbage
        assert whole.counts[topic.name] > 0.4 * COUNT
