"""A simulation that is started again with another option while it is recorded, and messages that are not of it."""

import signal
import subprocess
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from rled_msgs_py.bags import Bag, review
from rled_msgs_py.records import Level, Text
from rled_msgs_py.ros.convert import to_msg
from rled_msgs_py.ros.node import advertise
from rled_msgs_py.topics import TASK_DESCRIPTION

from .conftest import Observer
from .programs import ENDLESS, WAIT_TIMEOUT, running

RECORDER = "record_demos: bag"


def simulation(*options: str) -> "AbstractContextManager[subprocess.Popen[str]]":
    return running("rled_sim", "sim_node", "--robot", "planar", "--mode", "real_time", *ENDLESS, *options)


def ended(recorder: "subprocess.Popen[str]") -> str:
    recorder.send_signal(signal.SIGINT)
    _, said = recorder.communicate(timeout=WAIT_TIMEOUT)
    assert recorder.returncode == 0, said
    return said


def is_warned(observer: Observer, about: str) -> Callable[[], bool]:
    def warned() -> bool:
        health = observer.health.get(RECORDER)
        return health is not None and health.level == Level.WARN and about in health.message

    return warned


def restart_of(observer: Observer) -> Callable[[], bool]:
    """Whether the simulation has begun anew since now, and 30 of its ticks are there."""
    begun, newest = len(observer.ticks), observer.ticks[-1].stamp

    def begun_anew() -> bool:
        since = [tick.stamp for tick in observer.ticks[begun:]]
        first = next((index for index, stamp in enumerate(since) if stamp < newest), len(since))
        return len(since) > first + 30

    return begun_anew


def recorded(observer: Observer) -> int:
    """Messages that the recorder says it has kept."""
    return int(observer.health[RECORDER].values["messages"])


def test_a_restart_with_another_option_makes_another_bag(tmp_path: Path, ros_domain: int) -> None:
    observer, bag = Observer(), tmp_path / "a bag"
    with ExitStack() as stack:
        stack.callback(observer.close)
        recorder = stack.enter_context(running("rled_teleop", "record_demos", "--output", str(bag)))
        with simulation():
            observer.wait(lambda: RECORDER in observer.health, "the recorder")
            observer.wait(lambda: "recording" in observer.health[RECORDER].message, "a recording")
            observer.wait_ticks(60)
            again = restart_of(observer)
        with simulation("--max-steps", "50"):
            observer.wait(is_warned(observer, "max_steps 0, now 50"), "a warning")
            observer.wait(again, "ticks of the new simulation")
            before = recorded(observer)  # reports may lag: what follows is of the new simulation
            observer.wait(lambda: recorded(observer) >= before + 5 * 30, "its ticks in the bag")
            said = ended(recorder)
    assert "another task_description came while recording (max_steps 0, now 50)" in said
    first, second = Bag(bag), Bag(tmp_path / "a bag_2")
    assert [(each.note, each.task.max_steps) for each in (first, second)] == [("", 0), ("", 50)]
    for each in (first, second):
        found = review(each)
        assert found.faults == []
        assert len(found.timeline.moments) >= 25
        assert len(found.episodes) == 1
    assert not (tmp_path / "a bag_3").exists()


def test_a_stray_description_is_said_and_left_out(tmp_path: Path, ros_domain: int) -> None:
    observer, bag = Observer(), tmp_path / "bag"
    with ExitStack() as stack:
        stack.callback(observer.close)
        recorder = stack.enter_context(running("rled_teleop", "record_demos", "--output", str(bag)))
        stack.enter_context(simulation())
        observer.wait(lambda: RECORDER in observer.health, "the recorder")
        observer.wait(lambda: "recording" in observer.health[RECORDER].message, "a recording")
        observer.wait_ticks(200)
        stray = advertise(observer.node, TASK_DESCRIPTION)
        observer.wait(lambda: stray.get_subscription_count() >= 2, "the recorder to listen")
        stray.publish(to_msg(Text('{"robot": "another"}')))
        observer.wait(is_warned(observer, "another task_description came"), "a warning")
        observer.wait_ticks(30)
        said = ended(recorder)
    assert "another task_description came while recording" in said
    (only,) = tmp_path.iterdir()
    assert (Bag(only).note, Bag(only).counts["task_description"]) == ("", 1)
    assert review(Bag(only)).faults == []
