"""Every kind of fault, put into a real demonstration: `demos check` names it with episode, time and remedy, the remedy
works as printed, and `train_expert` refuses the bag or leaves out just that part, saying so."""

import re
import shlex
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rled_agent.data.opening import open_demonstrations
from rled_msgs_py.bags import Bag, BagWriter, review
from rled_msgs_py.bags.header import moved, sim_stamp
from rled_msgs_py.bags.stream import Message
from rled_msgs_py.errors import RledError
from rled_msgs_py.messages import decode, encode
from rled_msgs_py.records import JointSample
from rled_msgs_py.topics import EE_POSE, JOINT_STATES
from rled_teleop.cli import demos
from rosbags.rosbag2 import StoragePlugin

from ..rled_msgs_py.samples import recording
from ..rled_msgs_py.test_bag_peers import write_with_rosbags

PLANAR = Path(__file__).parents[2] / "bags" / "planar_lemniscate"
SECOND = 1_000_000_000
AT = 10 * SECOND
"""Where the fault is put (ns of simulation time since the first state)."""

Change = Callable[[str, int, Message], Iterator[bytes]]
LINE = re.compile(
    r"(?P<kind>[a-z ]+): .+, (episodes? (?P<episode>\d+).*|outside the episodes), (at|from) (?P<time>[\d.]+) s.*: .+"
)


def of_joints(change: Callable[[JointSample], JointSample]) -> Callable[[bytes], bytes]:
    def changed(data: bytes) -> bytes:
        sample = decode(JOINT_STATES, data)
        assert isinstance(sample, JointSample)
        return encode(JOINT_STATES, change(sample))

    return changed


elsewhere = of_joints(lambda sample: replace(sample, position=sample.position + 0.5))
renamed = of_joints(lambda sample: replace(sample, names=("shoulder", "wrist")))


def two_publishers(name: str, stamp: int, message: Message) -> Iterator[bytes]:
    yield message.data
    if name == JOINT_STATES.name and 0 <= stamp < SECOND // 5:
        yield elsewhere(message.data)


def names_change(name: str, stamp: int, message: Message) -> Iterator[bytes]:
    yield renamed(message.data) if name == JOINT_STATES.name and stamp >= 0 else message.data


def not_valid(name: str, stamp: int, message: Message) -> Iterator[bytes]:
    yield message.data[:40] if name == JOINT_STATES.name and stamp == 0 else message.data


def clock_set_ahead(name: str, stamp: int, message: Message) -> Iterator[bytes]:
    yield moved(name, message.topic.type, message.data, 5 * SECOND) if stamp > 0 else message.data


def topic_stops(name: str, stamp: int, message: Message) -> Iterator[bytes]:
    if name != EE_POSE.name or not 0 <= stamp < SECOND:
        yield message.data


def messages_lost(name: str, stamp: int, message: Message) -> Iterator[bytes]:
    if not 0 < stamp < SECOND // 20:
        yield message.data


def changed(path: Path, change: Change) -> Path:
    """A copy of the planar demonstration; ``change`` is told stamps as time since ``AT`` (descriptions: long ago)."""
    bag = Bag(PLANAR)
    with BagWriter(path) as writer:
        for message in bag.messages():
            name = bag.name_of(message)
            stamp = sim_stamp(name, message.topic.type, message.data)
            for data in change(name, -AT if stamp is None else stamp - AT, message):
                now = sim_stamp(name, message.topic.type, data)
                writer.copy(message.topic, data, message.log_time if now is None else now, message.publish_time)
    return path


def restarted(path: Path) -> Path:
    """The planar demonstration twice in one bag, as when the simulation was started anew."""
    bag = Bag(PLANAR)
    with BagWriter(path) as writer:
        for message in [*bag.messages(), *bag.messages()]:
            writer.copy(message.topic, message.data, message.log_time, message.publish_time)
    return path


CHANGES = {
    "two publishers": (two_publishers, None),
    "names change": (names_change, 551),  # 1052 states, 500 of them before; the last one is not answered
    "not valid": (not_valid, 1),
    "clock jump": (clock_set_ahead, 0),
    "topic stops": (topic_stops, 50),  # one second
    "messages lost": (messages_lost, 2),
}
"""Each with the transitions that it costs; None where the whole bag is refused."""


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[[str], tuple[Any, list[str]]]:
    """Run a command line of `demos`; returns its exit code and the lines that it printed."""

    def run(command: str) -> tuple[Any, list[str]]:
        monkeypatch.setattr(sys, "argv", shlex.split(command))
        capsys.readouterr()
        code: Any = 0
        try:
            demos.main()
        except SystemExit as ended:
            code = ended.code
        return code, capsys.readouterr().out.splitlines()

    return run


@pytest.mark.parametrize("kind", CHANGES)
def test_a_fault_is_named_with_its_episode_and_time_and_the_remedy_works(
    call: Callable[[str], tuple[Any, list[str]]], tmp_path: Path, kind: str
) -> None:
    path = changed(tmp_path / "bag", CHANGES[kind][0])
    code, lines = call(f"demos check {path}")
    assert code == 1
    found = next(match for line in lines if (match := LINE.fullmatch(line)) and match["kind"] == kind)
    began = review(Bag(PLANAR))
    where = [each.number for each in began.episodes if each.first <= AT <= each.last]
    if kind != "names change":  # no motion ends after that, so there is no such episode
        assert int(found["episode"]) in (*where, *(number + 1 for number in where))
    assert float(found["time"]) == pytest.approx(AT / SECOND, abs=0.045)
    (remedy,) = re.findall(r"demos (?:trim|drop) .+? --output NEW", found[0])[:1]
    assert call(remedy.replace("NEW", str(tmp_path / "new")))[0] == 0
    assert not any(line.startswith(f"{kind}: ") for line in call(f"demos check {tmp_path / 'new'}")[1])


@pytest.mark.parametrize("kind", CHANGES)
def test_train_expert_refuses_a_bag_with_the_fault_or_leaves_its_moments_out(tmp_path: Path, kind: str) -> None:
    (change, lost), lines = CHANGES[kind], list[str]()
    path = changed(tmp_path / "bag", change)
    if lost is None:
        with pytest.raises(RledError, match=rf"{kind}|{re.escape(str(path))}"):
            open_demonstrations(path, "trajectories", 0.0, lines.append)
        return
    left = open_demonstrations(path, "trajectories", 0.0, lines.append)
    assert len(open_demonstrations(PLANAR, "trajectories")) - len(left) == lost
    assert len(lines) == 1
    assert lines[0].startswith("left out: 10.00 s")


def test_a_restart_is_named_in_the_episode_before_it_and_refused(
    call: Callable[[str], tuple[Any, list[str]]], tmp_path: Path
) -> None:
    path = restarted(tmp_path / "bag")
    code, lines = call(f"demos check {path}")
    assert code == 1
    found = next(match for line in lines if (match := LINE.fullmatch(line)) and match["kind"] == "stamps backwards")
    remedy = re.findall(r"demos trim .+? --output NEW", found[0])[0]
    assert call(remedy.replace("NEW", str(tmp_path / "new")))[0] == 0
    assert call(f"demos check {tmp_path / 'new'}")[0] == 0
    with pytest.raises(RledError, match="stamps backwards"):
        open_demonstrations(path, "trajectories")


def test_a_sqlite3_bag_is_checked_like_any_other(call: Callable[[str], tuple[Any, list[str]]], tmp_path: Path) -> None:
    path = write_with_rosbags(tmp_path / "bag", recording(30), plugin=StoragePlugin.SQLITE3)
    assert call(f"demos check {path}") == (0, [f"{path}: no faults in 152 messages, 1 episode"])
    torn = [*recording(30), *recording(30)[2:]]
    code, lines = call(f"demos check {write_with_rosbags(tmp_path / 'torn', torn, plugin=StoragePlugin.SQLITE3)}")
    assert code == 1
    assert all(LINE.fullmatch(line) for line in lines)
