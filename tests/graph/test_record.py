"""Recording: record_demos, sim_node and teleop_scripted as processes of their own, and the bags that come of it."""

import json
import random
import re
import resource
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from mcap.reader import make_reader
from rclpy.executors import SingleThreadedExecutor
from rled_msgs_py.bags import Bag, repair
from rled_msgs_py.processes import program
from rled_msgs_py.records import Health, Level
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.ros.node import advertise, fresh_context, spin_until, subscribe
from rled_msgs_py.topics import (
    DIAGNOSTICS,
    EE_POSE,
    EPISODE_EVENTS,
    JOINT_DELTA,
    JOINT_STATES,
    MARKED_EE_POSE,
    MARKED_JOINT_STATES,
    RECORDED,
    SAFETY_GATE,
    TARGET_POSE,
    TASK_STATUS,
    Topic,
)
from rled_sim.robots import robot_named
from rled_sim.tasks import reach_task
from rled_teleop.operators.demonstration import demonstrated_action
from rled_teleop.operators.scripted import spread
from std_srvs.srv import SetBool, Trigger

WAIT_TIMEOUT = 60.0
SCRIPTED = ("--operator", "scripted", "--robot", "planar", "--sim-options=--discovery-wait 0.2")
SMALL = (*SCRIPTED, "--points", "40", "--trajectories", "5")


class Process:
    """One of our programs, started as a person would."""

    def __init__(self, package: str, name: str, *arguments: str) -> None:
        command = [*program(package, name), *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def end(self, number: int | None = None) -> tuple[int, str, str]:
        """Send a signal, if one is given; wait for the end; return exit code, stdout and stderr."""
        if number is not None:
            self.process.send_signal(number)
        try:
            out, err = self.process.communicate(timeout=WAIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        return self.process.returncode, out, err

    def close(self) -> None:
        if self.process.returncode is None:
            self.process.kill()
            self.process.communicate()


def recorder(output: Path, *arguments: str) -> Process:
    return Process("rled_teleop", "record_demos", "--output", str(output), *arguments)


def record(output: Path, *arguments: str) -> tuple[int, str, str]:
    return recorder(output, *arguments).end()


def await_that(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + WAIT_TIMEOUT
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.02)


def grows_beyond(bag: Path, size: int) -> Callable[[], bool]:
    return lambda: sum(each.stat().st_size for each in bag.glob("*.mcap*")) > size


def messages(bag: Path) -> list[tuple[str, int, bytes]]:
    """Every message as an independent reader sees it, in the order of the file."""
    with (bag / f"{bag.name}_0.mcap").open("rb") as file:
        read = make_reader(file).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in read]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory, ros_domain: int) -> tuple[Path, Path, str]:
    """Two recordings with one seed, and what the first one printed."""
    folder = tmp_path_factory.mktemp("recordings")
    printed = ""
    for name in ("one", "other"):
        code, out, err = record(folder / name / "bag", *SMALL, "--seed", "4")
        assert code == 0, err
        printed = printed or out
    return folder / "one" / "bag", folder / "other" / "bag", printed


@pytest.fixture(scope="module")
def bag(recordings: tuple[Path, Path, str]) -> Bag:
    return Bag(recordings[0])


def test_the_commands_and_a_summary_are_printed(recordings: tuple[Path, Path, str]) -> None:
    lines = recordings[2].splitlines()
    assert [line.split()[1].rpartition("/")[2] for line in lines if line.startswith("$")] == [
        "sim_node",
        "teleop_scripted",
    ]
    assert "40 points, 5 trajectories" in lines[-1]
    assert "without an answer" not in lines[-1]
    assert "LOST" not in lines[-1]


def test_the_points_asked_for_are_marked_on_the_curve(bag: Bag) -> None:
    joints, poses = bag.joints(MARKED_JOINT_STATES), bag.poses(MARKED_EE_POSE)
    robot = robot_named("planar")
    assert len(joints.stamps) == 40
    np.testing.assert_array_equal(joints.stamps, poses.stamps)
    np.testing.assert_allclose(poses.position, spread(reach_task(robot).targets, 40), atol=2e-4)
    np.testing.assert_allclose(robot.chain.position(joints.position), poses.position, atol=1e-9)


def test_a_mark_is_a_copy_of_the_state_of_its_stamp(bag: Bag) -> None:
    for topic, marked in ((JOINT_STATES, MARKED_JOINT_STATES), (EE_POSE, MARKED_EE_POSE)):
        table = bag.joints if topic is JOINT_STATES else bag.poses
        states, marks = table(topic), table(marked)
        places = np.searchsorted(states.stamps, marks.stamps)
        np.testing.assert_array_equal(states.stamps[places], marks.stamps)
        np.testing.assert_array_equal(states.position[places], marks.position)


def test_every_state_but_the_last_is_answered_and_none_is_missing(bag: Bag) -> None:
    states, deltas = bag.joints(JOINT_STATES).stamps, bag.joints(JOINT_DELTA).stamps
    np.testing.assert_array_equal(states, np.arange(len(states)) * bag.task.period)
    np.testing.assert_array_equal(deltas, states[:-1])
    for topic in (EE_POSE, TARGET_POSE):
        np.testing.assert_array_equal(bag.poses(topic).stamps, states)
    assert bag.counts[TASK_STATUS.name] == len(states)
    assert bag.counts[SAFETY_GATE.name] == 0


def test_the_trajectories_asked_for_reach_their_targets_safely(bag: Bag) -> None:
    statuses: Any = list(bag.records(TASK_STATUS))
    last_mark = bag.joints(MARKED_JOINT_STATES).stamps[-1]
    before = next(each.targets_reached for each in statuses if each.stamp == last_mark)
    assert statuses[-1].targets_reached - before == 5
    assert statuses[-2].targets_reached - before == 4
    assert not any(each.risky for each in statuses)


def test_the_recorded_motion_is_the_demonstrated_action(bag: Bag) -> None:
    marks, deltas = bag.joints(MARKED_JOINT_STATES), bag.joints(JOINT_DELTA)
    states, targets = bag.joints(JOINT_STATES), bag.poses(TARGET_POSE)
    positions = bag.poses(MARKED_EE_POSE).position
    for k in np.flatnonzero(deltas.stamps >= marks.stamps[-1]):
        nearest = np.linalg.norm(positions - targets.position[k], axis=1).argmin()
        expected = demonstrated_action(states.position[k], marks.position[nearest], bag.task.max_delta)
        np.testing.assert_allclose(deltas.position[k], expected, atol=1e-12)


def test_two_runs_with_one_seed_give_identical_messages(recordings: tuple[Path, Path, str]) -> None:
    one, other = messages(recordings[0]), messages(recordings[1])
    topics = {topic for topic, _, _ in one}
    assert topics == {f"/{topic.name}" for topic in RECORDED} - {"/safety_gate", "/human/joint_delta"}
    for topic in topics:
        assert [each for each in one if each[0] == topic] == [each for each in other if each[0] == topic]


def test_messages_lie_in_the_order_of_their_stamps(recordings: tuple[Path, Path, str]) -> None:
    times = [log_time for _, log_time, _ in messages(recordings[0])]
    assert times == sorted(times)


def test_another_seed_draws_other_targets(tmp_path: Path, bag: Bag) -> None:
    options = ("--points", "40", "--trajectories", "5", "--seed", "5")
    code, _, err = record(tmp_path / "bag", *SCRIPTED, *options, "--operator-options=--tremor 0.05")
    assert code == 0, err
    other = Bag(tmp_path / "bag")
    assert other.metadata["seed"] == "5"
    assert other.metadata["operator_options"] == "--tremor 0.05"
    assert other.poses(TARGET_POSE).position[-1].tolist() != bag.poses(TARGET_POSE).position[-1].tolist()
    assert len(other.joints(MARKED_JOINT_STATES).stamps) == 40
    largest = np.abs(other.joints(JOINT_DELTA).position).max()
    assert largest <= other.task.max_delta


def refused(output: Path, *arguments: str) -> str:
    """The one line that a refused command ends with."""
    code, _, err = record(output, *arguments)
    assert code == 2
    assert "Traceback" not in err
    return err.strip().splitlines()[-1]


def test_a_folder_that_is_there_is_refused_and_kept(recordings: tuple[Path, Path, str]) -> None:
    before = messages(recordings[1])
    assert "exists" in refused(recordings[1], *SMALL)
    assert messages(recordings[1]) == before


def test_no_folder_given_is_refused() -> None:
    code, _, err = Process("rled_teleop", "record_demos").end()
    assert (code, err.strip()) == (2, "error: no folder to record into; accepted: --output FOLDER")


def test_an_unknown_robot_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    line = refused(tmp_path / "bag", "--operator", "scripted", "--robot", "pandda")
    assert line.startswith("error: unknown robot 'pandda'; accepted: panda, planar")
    assert not (tmp_path / "bag").exists()


def test_too_few_points_for_the_targets_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    line = refused(tmp_path / "bag", *SCRIPTED, "--points", "4", "--trajectories", "1")
    assert "teleop_scripted ended with exit code 2" in line
    assert not (tmp_path / "bag").exists()


def test_an_unknown_topic_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    assert "unknown topic 'nose'" in refused(tmp_path / "bag", "--topics", "markers,nose")
    assert not (tmp_path / "bag").exists()


def test_a_recording_of_nothing_is_said_and_leaves_nothing(tmp_path: Path) -> None:
    with closing(recorder(tmp_path / "bag")) as recording:
        await_that((tmp_path / "bag").exists, "the folder")
        code, _, err = recording.end(signal.SIGINT)
    assert code == 2
    assert "nothing was recorded" in err
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_recording_is_a_whole_bag(tmp_path: Path, number: signal.Signals) -> None:
    with closing(recorder(tmp_path / "bag", *SCRIPTED, "--trajectories", "100000")) as recording:
        await_that(grows_beyond(tmp_path / "bag", 60_000), "messages")
        code, _, err = recording.end(number)
    assert code == 130
    assert "interrupted" in err
    bag = Bag(tmp_path / "bag")
    stamps = bag.joints(JOINT_STATES).stamps
    np.testing.assert_array_equal(stamps, np.arange(len(stamps)) * bag.task.period)


def test_a_killed_recording_can_be_repaired_and_its_children_end(tmp_path: Path) -> None:
    with closing(recorder(tmp_path / "bag", *SCRIPTED, "--trajectories", "100000")) as recording:
        await_that(grows_beyond(tmp_path / "bag", 60_000), "messages")
        recording.process.kill()
        recording.end()  # the pipes close when the children have ended too
    repair(tmp_path / "bag")
    bag = Bag(tmp_path / "bag")
    stamps = bag.joints(JOINT_STATES).stamps
    np.testing.assert_array_equal(stamps, np.arange(len(stamps)) * bag.task.period)


class Person:
    """Calls the recorder's services."""

    def __init__(self, domain: int) -> None:
        self._context = fresh_context(domain)
        self._node = rclpy.create_node("person", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self._node.create_client(kind, name)
        spin_until(self._executor, client.service_is_ready, WAIT_TIMEOUT, name)
        future = client.call_async(request)
        spin_until(self._executor, future.done, WAIT_TIMEOUT, f"an answer of {name}")
        return future.result()

    def listen(self, topic: Topic) -> list[Any]:
        """The records that arrive on a topic, from now on."""
        records: list[Any] = []
        subscribe(self._node, topic, records.append)
        return records

    def speaker(self, topic: Topic) -> Callable[[Any], None]:
        """Publishes records on a topic."""
        publisher = advertise(self._node, topic)
        return lambda record: publisher.publish(to_msg(record))

    def await_that(self, condition: Callable[[], bool], what: str) -> None:
        spin_until(self._executor, condition, WAIT_TIMEOUT, what)

    def close(self) -> None:
        self._node.destroy_node()
        self._context.try_shutdown()


@contextmanager
def recording_of_a_running_simulation(bag: Path, domain: int, *arguments: str) -> Iterator[tuple[Process, Person]]:
    simulation = Process("rled_sim", "sim_node", "--robot", "planar", "--mode", "real_time", "--discovery-wait", "0.2")
    with closing(simulation), closing(recorder(bag, *arguments)) as recording, closing(Person(domain)) as person:
        await_that(grows_beyond(bag, 200_000), "messages")
        yield recording, person


def test_a_person_marks_poses_and_records_episodes_in_real_time(tmp_path: Path, ros_domain: int) -> None:
    path = tmp_path / "bag"
    options = ("--topics", "/diagnostics", "--operator-name", "me")
    with recording_of_a_running_simulation(path, ros_domain, *options) as (recording, person):
        marked = [person.call(Trigger, "record_demos/mark_pose", Trigger.Request()) for _ in range(3)]
        ended = person.call(SetBool, "record_demos/record", SetBool.Request(data=False))
        refusals = [
            person.call(Trigger, "record_demos/mark_pose", Trigger.Request()),
            person.call(SetBool, "record_demos/record", SetBool.Request(data=False)),
        ]
        person.call(Trigger, "record_demos/discard", Trigger.Request())
        person.call(SetBool, "record_demos/record", SetBool.Request(data=True))
        kept = person.call(Trigger, "record_demos/keep", Trigger.Request())
        person.call(SetBool, "record_demos/record", SetBool.Request(data=True))
        code, out, err = recording.end(signal.SIGINT)
    assert code == 0, err
    assert [each.success for each in marked] == [True, True, True]
    assert ended.message == "episode 0 ended"
    assert [(each.success, each.message) for each in refusals] == [
        (False, "paused"),
        (False, "no episode is being recorded"),
    ]
    assert kept.message == "episode 1 kept"
    bag = Bag(path)
    assert "3 points" in out
    assert "LOST" not in out
    np.testing.assert_array_equal(bag.joints(MARKED_JOINT_STATES).stamps, bag.poses(MARKED_EE_POSE).stamps)
    assert bag.counts[DIAGNOSTICS.name] > 0
    assert bag.counts[JOINT_DELTA.name] == 0
    events = events_of(bag)
    assert [(each["event"], each["episode"]) for each in events] == [
        ("start", 0),
        ("stop", 0),
        ("discard", 0),
        ("start", 1),
        ("stop", 1),
        ("keep", 1),
        ("start", 2),
        ("stop", 2),
    ]
    assert {(each["operator"], each["robot"], each["max_delta"]) for each in events} == {("me", "planar", 0.1)}
    stamps = [each["stamp"] for each in events]
    assert stamps == sorted(stamps)
    assert_states_lie_within_episodes(bag, events)


def events_of(bag: Bag) -> list[dict[str, Any]]:
    records: Any = bag.records(EPISODE_EVENTS)
    return [json.loads(record.data) for record in records]


def assert_states_lie_within_episodes(bag: Bag, events: list[dict[str, Any]]) -> None:
    starts = [each["stamp"] for each in events if each["event"] == "start"]
    stops = [each["stamp"] for each in events if each["event"] == "stop"]
    for stamp in bag.joints(JOINT_STATES).stamps:
        assert any(start <= stamp <= stop for start, stop in zip(starts, stops, strict=True))


def test_a_scripted_recording_is_one_episode_that_reached_its_targets(bag: Bag) -> None:
    start, stop = events_of(bag)
    states = bag.joints(JOINT_STATES).stamps
    assert (start["event"], start["stamp"], start["operator"]) == ("start", 0, "scripted")
    assert (stop["event"], stop["stamp"], stop["outcome"]) == ("stop", states[-1], "reached")


def test_a_paused_recorder_waits_for_the_first_episode(tmp_path: Path, ros_domain: int) -> None:
    simulation = Process("rled_sim", "sim_node", "--robot", "planar", "--mode", "real_time", "--discovery-wait", "0.2")
    path = tmp_path / "bag"
    with closing(simulation), closing(recorder(path, "--paused")) as recording, closing(Person(ros_domain)) as person:
        await_that(
            lambda: person.call(SetBool, "record_demos/record", SetBool.Request(data=True)).success, "an episode"
        )
        await_that(grows_beyond(path, 20_000), "messages")
        code, _, err = recording.end(signal.SIGINT)
    assert code == 0, err
    assert [each["event"] for each in events_of(Bag(path))] == ["start", "stop"]


def test_the_next_recording_repairs_what_a_killed_one_left(tmp_path: Path) -> None:
    with closing(recorder(tmp_path / "killed", *SCRIPTED, "--trajectories", "100000")) as recording:
        await_that(grows_beyond(tmp_path / "killed", 60_000), "messages")
        recording.process.kill()
        recording.end()
    code, _, err = record(tmp_path / "next", *SMALL)
    assert code == 0, err
    assert re.search(r"killed was left unfinished and is repaired: it holds \d+ messages", err)
    stamps = Bag(tmp_path / "killed").joints(JOINT_STATES).stamps
    np.testing.assert_array_equal(stamps, np.arange(len(stamps)) * Bag(tmp_path / "killed").task.period)


def test_a_recording_beside_another_leaves_it_alone(tmp_path: Path) -> None:
    with closing(recorder(tmp_path / "one", *SCRIPTED, "--trajectories", "100000")) as recording:
        await_that(grows_beyond(tmp_path / "one", 60_000), "messages")
        line = refused(tmp_path / "one", *SMALL)
        assert "exists" in line
        code, _, _ = recording.end(signal.SIGINT)
    assert code == 130
    Bag(tmp_path / "one")


def test_a_full_disk_ends_the_recording_loudly_and_keeps_what_was_written(tmp_path: Path, ros_domain: int) -> None:
    path, limit = tmp_path / "bag", 1_500_000  # DDS has files of its own in memory, of half a megabyte
    noise = random.Random(0)
    with closing(Person(ros_domain)) as person:
        reports, say = person.listen(DIAGNOSTICS), person.speaker(DIAGNOSTICS)

        def fill_until_it_fails() -> bool:
            say(Health(0, Level.OK, "filler", "", {"noise": noise.randbytes(10_000).hex()}))
            return any(each.level is Level.ERROR for each in reports)

        arguments = (*SCRIPTED, "--trajectories", "100000", "--topics", "/diagnostics")
        with closing(recorder(path, *arguments)) as recording:
            await_that(path.exists, "the folder")
            resource.prlimit(recording.process.pid, resource.RLIMIT_FSIZE, (limit, limit))
            person.await_that(lambda: any(int(each.values.get("messages", 0)) > 500 for each in reports), "messages")
            person.await_that(fill_until_it_fails, "its last report")
            code, _, err = recording.end()
    assert code == 2
    assert "RECORDING STOPPED" in err
    assert 'File "' not in err  # no traceback
    assert err.splitlines()[-1].startswith("error: writing ")
    assert re.search(r"error: writing .*bag_0.mcap failed: File too large; kept: the first \d+ messages", err)
    (report,) = (each for each in reports if each.level is Level.ERROR)
    assert report.message.startswith("RECORDING STOPPED")
    kept = int(re.findall(r"kept: the first (\d+) messages", err)[-1])
    assert repair(path).messages == kept > 500
    stamps = Bag(path).joints(JOINT_STATES).stamps
    np.testing.assert_array_equal(stamps, np.arange(len(stamps)) * Bag(path).task.period)
