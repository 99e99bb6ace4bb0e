"""Nodes come and go in any order: real processes that are started, interrupted, killed and started again."""

import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
from rled_agent.training.checkpoint import read_checkpoint
from rled_msgs_py.bags import Bag
from rled_msgs_py.processes import program
from rled_msgs_py.records import Actor, Level
from rled_msgs_py.topics import JOINT_DELTA, JOINT_STATES
from std_srvs.srv import SetBool

from .conftest import Observer
from .team import actor_like

PACKAGES = {"sim_node": "rled_sim", "agent_node": "rled_agent", "record_demos": "rled_teleop"}
REPORTS = {"sim_node": "sim: driver", "agent_node": "agent_node: policy", "record_demos": "record_demos: bag"}
SAID = {
    "sim_node": "planar is there, in real time: a tick every 20 ms",
    "agent_node": "a simulation is there; answers states",
    "record_demos": "bag; Ctrl-C completes the bag",
}
WAIT_TIMEOUT = 60.0
ENDLESS = ("--robot", "planar", "--discovery-wait", "0.2", "--targets-per-episode", "0", "--max-steps", "0")
REAL_TIME = (*ENDLESS, "--mode", "real_time")
STILL = 0.2
"""Seconds without motion that count as holding still; a tick is 20 ms."""


class Program:
    """A running program of ours."""

    def __init__(self, name: str, *arguments: object) -> None:
        command = [*program(PACKAGES[name], name), *map(str, arguments)]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)

    def end(self, number: int) -> float:
        """Send a signal; returns how long it went on, less what it and its children waited for a processor (s)."""
        family = [self.process.pid, *children_of(self.process.pid)]
        queued, before = {each: queueing(each) for each in family}, sum(map(queueing, family))
        began = time.monotonic()
        self.process.send_signal(number)
        while self.process.poll() is None:
            assert time.monotonic() < began + WAIT_TIMEOUT
            queued |= {each: waited for each in family if (waited := queueing(each))}
            time.sleep(0.002)
        return time.monotonic() - began - (sum(queued.values()) - before)


def children_of(process: int) -> list[int]:
    tasks = Path(f"/proc/{process}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


def queueing(process: int) -> float:
    """How long a process's first thread has been ready to run, but was not let (s)."""
    try:
        return int(Path(f"/proc/{process}/schedstat").read_text().split()[1]) * 1e-9
    except (OSError, IndexError):
        return 0.0


@contextmanager
def running(name: str, *arguments: object) -> Iterator[Program]:
    started = Program(name, *arguments)
    try:
        yield started
    finally:
        started.process.kill()
        started.process.communicate()


@pytest.fixture(scope="module")
def actor(planar_expert: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return actor_like(planar_expert, tmp_path_factory.mktemp("actor") / "actor.safetensors")


@pytest.fixture
def learner(planar_expert: Path, actor: Path, tmp_path: Path) -> tuple[object, ...]:
    """Options of an agent that learns."""
    state = tmp_path / "learning.safetensors"
    files = "--expert", planar_expert, "--agent", actor, "--learning-state", state
    return *files, "--learn", "--learning-priority", "low", "--threshold", 1e6


def await_learning(observer) -> None:
    observer.wait_report(REPORTS["agent_node"], lambda health: int(health.values.get("handovers", 0)) > 1)


def await_report(observer, name: str) -> None:
    observer.wait_report(REPORTS[name], lambda health: True)


def await_silence(observer) -> int:
    """All ticks under way have come: none between two reports. Returns their number."""
    before = -1
    while before != (before := len(observer.ticks)):
        await_report(observer, "sim_node")
    return before


def await_motion(observer) -> None:
    """The robot moves now."""
    begun = len(observer.ticks)
    observer.wait(lambda: len({tick.joints.position.tobytes() for tick in observer.ticks[begun:]}) > 3, "motion")


def await_hold(observer) -> None:
    """The robot's ticks go on, and its joints stay."""

    def holds() -> bool:
        last = [tick.joints.position.tobytes() for tick in observer.ticks[begun:]][-10:]
        return len(last) == 10 and len(set(last)) == 1

    begun = len(observer.ticks)
    observer.wait(holds, "a hold")


def listeners(observer) -> set[str]:
    """Who hears commands."""
    return {each.node_name for each in observer.node.get_subscriptions_info_by_topic(JOINT_DELTA.name)}


@pytest.mark.parametrize("order", list(permutations(PACKAGES)), ids="-".join)
def test_nodes_start_in_any_order(observer, planar_expert: Path, tmp_path: Path, order: tuple[str, ...]) -> None:
    options = {
        "sim_node": REAL_TIME,
        "agent_node": ("--expert", planar_expert),
        "record_demos": ("--output", tmp_path / "bag"),
    }
    with ExitStack() as stack:
        started = {}
        for name in order:
            started[name] = stack.enter_context(running(name, *options[name]))
            await_report(observer, name)
        observer.wait(lambda: "record_demos" in listeners(observer), "the recorder's ear")
        observer.wait_report(REPORTS["agent_node"], lambda health: health.message == "driving")
        observer.wait_ticks(100)
        for name in reversed(order):
            started[name].end(signal.SIGINT)
            assert started[name].process.returncode == 0
            assert SAID[name] in started[name].process.stderr.read()
    bag = Bag(tmp_path / "bag")
    assert min(bag.counts[topic.name] for topic in (JOINT_STATES, JOINT_DELTA)) > 0


def test_an_agent_outlives_the_simulation_says_so_and_goes_on_with_the_next(observer, planar_expert: Path) -> None:
    name = REPORTS["agent_node"]
    with running("agent_node", "--expert", planar_expert) as agent:
        for losses in (1, 2):
            with running("sim_node", *ENDLESS):
                observer.wait_ticks(30)
                observer.wait_report(name, lambda health: health.message == "driving")
            died = time.monotonic()
            gone = observer.wait_report(name, lambda health: "simulation is gone" in health.message)
            assert time.monotonic() - died < 10.0  # a lease of 1 s, and what a busy machine adds
            assert (gone.level, gone.values["simulation_lost"]) == (Level.WARN, str(losses))
        assert agent.process.poll() is None


def test_the_robot_holds_when_the_agent_is_killed_and_the_next_one_goes_on(observer, planar_expert: Path) -> None:
    with running("sim_node", *REAL_TIME) as sim:
        for _ in range(2):
            with running("agent_node", "--expert", planar_expert):
                await_motion(observer)
            await_hold(observer)
        assert sim.process.poll() is None


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_simulation_and_recorder_end_within_a_second(observer, tmp_path: Path, number: int) -> None:
    with running("sim_node", *REAL_TIME) as sim, running("record_demos", "--output", tmp_path / "bag") as recorder:
        observer.wait_report(REPORTS["record_demos"], lambda health: health.message.startswith("recording"))
        observer.wait_ticks(20)
        took = [each.end(number) for each in (recorder, sim)]
        assert (recorder.process.returncode, sim.process.returncode) == (0, 0)
        assert max(took) < 1.0, took
    assert Bag(tmp_path / "bag").counts[JOINT_STATES.name] > 0


def test_an_agent_ends_within_a_second_and_learning_goes_on_where_it_was_saved(observer, learner, tmp_path) -> None:
    saved = [(0, 0)]
    with running("sim_node", *REAL_TIME):
        for number in (signal.SIGINT, signal.SIGKILL, signal.SIGTERM):
            with running("agent_node", *learner) as agent:
                await_learning(observer)
                took = agent.end(number)
                assert took < 1.0
                assert agent.process.returncode == (-number if number == signal.SIGKILL else 0)
            if number == signal.SIGKILL:  # the learning process outlives the agent, and saves
                observer.wait(lambda: progress(tmp_path) > saved[-1], "a saved state that has more in it")
            saved.append(progress(tmp_path))
    assert all(np.greater(after, before).all() for before, after in pairwise(saved))


def progress(folder: Path) -> tuple[int, int]:
    """Transitions and gradient steps in a saved state."""
    path = folder / "learning.safetensors"
    state = read_checkpoint(path).state if path.exists() else {"added": 0, "updates": 0}
    return state["replay.added"], state["learner.updates"]


def test_a_dead_learning_process_is_missed_and_started_again(observer, learner) -> None:
    name = REPORTS["agent_node"]
    with running("sim_node", *REAL_TIME), running("agent_node", *learner) as agent:
        await_learning(observer)
        for child in children_of(agent.process.pid):
            if b"learner_process" in Path(f"/proc/{child}/cmdline").read_bytes():
                subprocess.run(["kill", "-KILL", str(child)], check=True)
        report = observer.wait_report(name, lambda health: "learning process has ended" in health.message)
        assert report.level is Level.ERROR
        # the actor still drives, if only against a joint's limit: its weights are what they were when learning ended
        last = observer.ticks[-1].stamp
        observer.wait(lambda: observer.decisions[-1].stamp > last + 10**9, "decisions of a second")
        assert observer.decisions[-1].actor is Actor.AGENT
        assert observer.call(SetBool, "agent_node/learn", data=True).success
        await_learning(observer)


@pytest.fixture
def sides(ros_domain: int) -> Iterator[dict[str, Observer]]:
    """An observer of each of two robots."""
    sides = {name: Observer(name) for name in ("left", "right")}
    yield sides
    for observer in sides.values():
        observer.close()


def test_two_robots_in_two_namespaces_do_not_hear_each_other(sides, planar_expert: Path, tmp_path: Path) -> None:
    bag, robot = tmp_path / "bag", ("--robot", "planar", "--discovery-wait", "0.2")
    with ExitStack() as stack:

        def start(name: str, side: str, *options: object) -> Program:
            return stack.enter_context(running(name, *options, "--ros-args", "-r", f"__ns:=/{side}"))

        recorder = start("record_demos", "left", "--output", bag)
        for seed, side in enumerate(sides):
            start("sim_node", side, *robot, "--seed", seed)
            start("agent_node", side, "--expert", planar_expert)
        sides["left"].wait_report("record_demos: bag", lambda health: health.message.startswith("recording"))
        begun = len(sides["left"].ticks)
        sides["left"].wait(lambda: len(sides["left"].ticks) > begun + 70, "ticks that are recorded")
        sides["right"].wait_ticks(50)
        answer = sides["left"].call(SetBool, "agent_node/enable", data=False)
        assert answer.message == "silent: the robot holds"
        still = await_silence(sides["left"])
        sides["right"].wait_ticks(50)
        await_report(sides["left"], "sim_node")
        assert len(sides["left"].ticks) == still
        recorder.end(signal.SIGINT)
    left, right = ([(tick.stamp, *tick.joints.position) for tick in sides[name].ticks] for name in sides)
    assert left[1:50] != right[1:50]
    table = Bag(bag).joints(JOINT_STATES)
    recorded = {(int(stamp), *position) for stamp, position in zip(table.stamps, table.position, strict=True)}
    assert len(recorded & set(left)) > 50
    assert not recorded & (set(right) - set(left))
