"""Command: record a demonstration from the topics into a bag; with an operator named, everything is started."""

import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event

from rclpy.experimental import EventsExecutor
from rled_msgs_py.bags import BagError, BagWriter
from rled_msgs_py.bags.splitting import split
from rled_msgs_py.errors import RledError
from rled_msgs_py.processes import Child, Children, program
from rled_msgs_py.ros.node import run_node
from rled_msgs_py.topics import JOINT_DELTA, MARKED_JOINT_STATES
from rled_sim.robots import robot_named
from rled_sim.tasks import require_task

from rled_teleop import __version__
from rled_teleop.nodes.recorder import Recorder
from rled_teleop.recording.params import RecordParams
from rled_teleop.recording.summary import summarise
from rled_teleop.recording.unfinished import repair_unfinished

SPIN_TIMEOUT = 0.05
"""Longest wait for a message before signals and children are looked at again (s)."""
LAST_MESSAGES_TIMEOUT = 2.0
"""How long messages are waited for after the operator has ended (s)."""


def record(node: Recorder, stop: Event) -> None:
    """Record until the operator has ended, or until SIGINT or SIGTERM.

    Raises:
        RledError: a mistake in the parameters, the folder exists, or a child process failed.
    """
    params = node.params
    folder = _checked(params)
    for said in repair_unfinished(folder.parent):
        print(said, file=sys.stderr)
    with opened(BagWriter(folder, metadata=_metadata(params), overwrite=params.overwrite)) as bag:
        with Children() as children:
            node.begin(bag)
            operator = _start(children, params) if params.operator != "none" else None
            _spin(node, stop, children, operator)
        node.finish()
    for path in split(folder) if node.descriptions.warning else [folder]:
        print(summarise(path))
    if operator is not None and stop.is_set():
        print("interrupted: the operator had not finished", file=sys.stderr)
        sys.exit(130)


@contextmanager
def opened(bag: BagWriter) -> Iterator[BagWriter]:
    """Complete a bag at the end of a block, or remove it when it holds no demonstration.

    A bag that could not be written any more stays as it is: what was written is kept.

    Raises:
        RledError: nothing was recorded.
    """
    try:
        with bag:
            yield bag
    except BagError:
        raise
    except RledError:
        if not (bag.counts[JOINT_DELTA.name] or bag.counts[MARKED_JOINT_STATES.name]):
            bag.remove()
        raise
    if not bag.counts.total():
        bag.remove()
        raise RledError("nothing was recorded", "", "is a simulation running in this ROS_DOMAIN_ID?")


def _checked(params: RecordParams) -> Path:
    if not params.output:
        raise RledError("no folder to record into", "--output FOLDER")
    if params.operator != "none":
        require_task(robot_named(params.robot).name)
    return Path(params.output)


def _metadata(params: RecordParams) -> dict[str, str]:
    """What the topics do not say about the recording."""
    given = {"operator": params.operator, "rled_teleop": __version__}
    if params.operator_name:
        given["operator_name"] = params.operator_name
    if params.operator != "none":
        given |= {"seed": str(params.seed), "operator_options": params.operator_options}
        given |= {"sim_options": params.sim_options}
    return given


def _start(children: Children, params: RecordParams) -> Child:
    """Start an endless simulation in lockstep and the operator; return the operator."""
    sim = ["--robot", params.robot, "--seed", str(params.seed), "--targets-per-episode", "0", "--max-steps", "0"]
    children.start([*program("rled_sim", "sim_node"), *sim, *shlex.split(params.sim_options)])
    asked = ["--points", str(params.points), "--trajectories", str(params.trajectories), "--seed", str(params.seed)]
    options = [*asked, "--wait-for-subscribers", "2", *shlex.split(params.operator_options)]
    name = f"teleop_{params.operator}"
    return children.start([*program("rled_teleop", name), *options], capture=False)


def _spin(node: Recorder, stop: Event, children: Children, operator: Child | None) -> None:
    executor = EventsExecutor(context=node.context)  # measured: half the processor time of the other executors
    executor.add_node(node)
    while not stop.is_set() and (operator is None or operator.exit_code is None):
        executor.spin_once(timeout_sec=SPIN_TIMEOUT)
        node.check()
        children.check()
    children.check()
    deadline = time.monotonic() + LAST_MESSAGES_TIMEOUT
    while operator is not None and not node.is_complete() and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=SPIN_TIMEOUT)
    executor.remove_node(node)


def main() -> None:
    """Run the command."""
    run_node(Recorder, RecordParams, "record_demos", "Record a demonstration from the topics into a bag.", record)


if __name__ == "__main__":
    main()
