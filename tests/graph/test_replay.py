"""A bag played back: what arrives is what was recorded, and the expert learns from it as from the file."""

import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rled_msgs_py.processes import program
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, qos_profile
from rled_msgs_py.ros.node import fresh_context, spin_until
from rled_msgs_py.topics import JOINT_DELTA, JOINT_STATES, RECORDED, ROBOT_DESCRIPTION
from rled_teleop.recording.bag_messages import read_recording
from std_srvs.srv import SetBool

WAIT_TIMEOUT = 60.0
QUICK = ("--steps", "60", "--validate-every", "20", "--architecture.hidden", "16", "16", "--batch-size", "32")


class Process:
    def __init__(self, package: str, name: str, *arguments: str) -> None:
        command = [*program(package, name), *arguments]
        self.process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def end(self, number: int | None = None) -> tuple[int, str, str]:
        if number is not None:
            self.process.send_signal(number)
        out, err = self.process.communicate(timeout=WAIT_TIMEOUT)
        return self.process.returncode, out, err

    def close(self) -> None:
        if self.process.returncode is None:
            self.process.kill()
            self.process.communicate()


class Listener:
    """Keeps every serialized message of the recorded topics."""

    def __init__(self, domain: int) -> None:
        self._context = fresh_context(domain)
        self.node = rclpy.create_node("listener", context=self._context)
        self.executor = SingleThreadedExecutor(context=self._context)
        self.executor.add_node(self.node)
        self.messages: dict[str, list[bytes]] = {topic.name: [] for topic in RECORDED}
        for topic in RECORDED:
            qos = qos_profile(replace(topic.qos, depth=10_000))
            keep: Callable[[Any], None] = self.messages[topic.name].append
            self.node.create_subscription(MESSAGE_CLASSES[topic.type], topic.name, keep, qos, raw=True)

    def await_that(self, condition: Callable[[], bool], what: str) -> None:
        spin_until(self.executor, condition, WAIT_TIMEOUT, what)

    def pause(self, on: bool) -> Any:
        client = self.node.create_client(SetBool, "replay_demos/pause")
        self.await_that(client.service_is_ready, "the player")
        future = client.call_async(SetBool.Request(data=on))
        self.await_that(future.done, "an answer")
        return future.result()

    def close(self) -> None:
        self.node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def listener(ros_domain: int) -> Iterator[Listener]:
    with closing(Listener(ros_domain)) as one:
        yield one


def in_bag(path: Path) -> dict[str, list[bytes]]:
    recording = read_recording(path)
    found: dict[str, list[bytes]] = {topic.name: [] for topic in RECORDED}
    for place, data in zip(recording.topic, recording.data, strict=True):
        found[recording.topics[place].name.removeprefix("/")].append(data)
    return found


def test_a_bag_arrives_as_it_was_recorded(planar_bag: Path, listener: Listener) -> None:
    with closing(
        Process("rled_teleop", "replay_demos", str(planar_bag), "--rate", "20", "--wait-for-subscribers", "1")
    ) as player:
        listener.await_that(lambda: player.process.poll() is not None, "the end")
        code, out, err = player.end()
    assert code == 0, err
    assert "messages played" in out
    expected = in_bag(planar_bag)
    listener.await_that(
        lambda: all(len(listener.messages[name]) >= len(sent) for name, sent in expected.items()), "messages"
    )
    for name, sent in expected.items():
        padding = [got[len(data) :] for got, data in zip(listener.messages[name], sent, strict=True)]
        assert all(got.startswith(data) for got, data in zip(listener.messages[name], sent, strict=True)), name
        assert max(map(len, padding), default=0) < 4  # DDS fills up to a multiple of four bytes


def test_quality_of_service_is_that_of_the_recording(planar_bag: Path, listener: Listener) -> None:
    with closing(Process("rled_teleop", "replay_demos", str(planar_bag), "--paused")) as player:
        for topic in (JOINT_STATES, JOINT_DELTA, ROBOT_DESCRIPTION):
            found = partial(listener.node.get_publishers_info_by_topic, topic.name)
            listener.await_that(lambda found=found: len(found()) == 1, f"the publisher of {topic.name}")
            (info,) = found()
            assert info.qos_profile.reliability.name.lower() == topic.qos.reliability
            assert info.qos_profile.durability.name.lower() == topic.qos.durability
        assert player.end(signal.SIGINT)[0] == 0


def test_a_pause_stands_still_and_a_loop_goes_on(planar_bag: Path, listener: Listener) -> None:
    states = listener.messages[JOINT_STATES.name]
    total = len(in_bag(planar_bag)[JOINT_STATES.name])
    with closing(Process("rled_teleop", "replay_demos", str(planar_bag), "--loop", "--rate", "10")) as player:
        listener.await_that(lambda: len(states) > 1.2 * total, "a second round")
        assert listener.pause(True).message == "paused"
        seen = [0, time.monotonic()]

        def stands_still() -> bool:
            if len(states) != seen[0]:
                seen[:] = len(states), time.monotonic()
            return time.monotonic() - seen[1] > 0.5  # at this rate a state comes every 2 ms

        listener.await_that(stands_still, "standing still")
        count = len(states)
        assert listener.pause(False).message == "playing"
        listener.await_that(lambda: len(states) > count, "more")
        assert player.end(signal.SIGINT)[0] == 0


def test_a_part_begins_with_the_descriptions(planar_bag: Path, listener: Listener) -> None:
    arguments = (str(planar_bag), "--start", "0.6", "--stop", "0.8", "--wait-for-subscribers", "1")
    with closing(Process("rled_teleop", "replay_demos", *arguments)) as player:
        listener.await_that(lambda: player.process.poll() is not None, "the end")
    listener.await_that(lambda: bool(listener.messages[ROBOT_DESCRIPTION.name]), "the description")
    listener.await_that(lambda: bool(listener.messages[JOINT_STATES.name]), "states")
    assert len(listener.messages[ROBOT_DESCRIPTION.name]) == 1
    assert len(listener.messages[JOINT_STATES.name]) <= 11  # 0.2 s of 20 ms each


@pytest.mark.parametrize(
    ("arguments", "what"),
    [((), "no bag to play"), (("gone",), "does not exist"), (("gone", "--rate", "0"), "rate is 0.0; accepted")],
)
def test_what_cannot_be_played_is_one_line(arguments: tuple[str, ...], what: str) -> None:
    code, _, err = Process("rled_teleop", "replay_demos", *arguments).end()
    assert code == 2
    assert what in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize("source", ["points", "trajectories"])
def test_the_expert_learns_the_same_weights_from_topics_as_from_the_file(
    planar_bag: Path, tmp_path: Path, source: str
) -> None:
    learn = partial(Process, "rled_agent", "train_expert", "--source", source, "--seed", "3", *QUICK, "--output")
    with closing(learn(str(tmp_path / "live"), "--live")) as learner:
        arguments = (str(planar_bag), "--rate", "5", "--wait-for-subscribers", "1")
        code, _, err = Process("rled_teleop", "replay_demos", *arguments).end()
        assert code == 0, err
        code, out, err = learner.end()
    assert code == 0, err
    assert f"{sum(map(len, in_bag(planar_bag).values())):,} messages received" in out
    code, _, err = learn(str(tmp_path / "file"), "--bag", str(planar_bag)).end()
    assert code == 0, err
    live, file = ((tmp_path / name / "expert.safetensors").read_bytes() for name in ("live", "file"))
    assert live == file


def test_a_live_learner_that_heard_nothing_is_one_line(tmp_path: Path) -> None:
    with closing(Process("rled_agent", "train_expert", "--live", "--output", str(tmp_path / "out"))) as learner:
        assert learner.process.stdout is not None
        assert "listening" in learner.process.stdout.readline()
        code, _, err = learner.end(signal.SIGINT)
    said = err.splitlines()[-1]
    assert (code, said) == (2, "error: no demonstration was received; is one played in this ROS_DOMAIN_ID?")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options", [(), ("--live", "--bag", "gone")])
def test_one_source_of_demonstrations_must_be_named(tmp_path: Path, options: tuple[str, ...]) -> None:
    code, _, err = Process("rled_agent", "train_expert", "--output", str(tmp_path / "out"), *options).end()
    assert code == 2
    assert "one of them" in err
