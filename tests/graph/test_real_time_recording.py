"""A demonstration in real time, with holds wherever the operator was late, is scored as what it was."""

import subprocess
from pathlib import Path

from rled_msgs_py.bags import Bag, review
from rled_msgs_py.processes import program
from rled_msgs_py.records import TaskStatus
from rled_msgs_py.topics import MARKED_JOINT_STATES, TASK_STATUS

WAIT_TIMEOUT = 240.0
TARGETS = 20


def test_a_drive_to_twenty_targets_in_real_time_has_twenty_targets(tmp_path: Path) -> None:
    asked = ["--operator", "scripted", "--robot", "planar", "--points", "40", "--trajectories", str(TARGETS)]
    options = ["--sim-options=--mode real_time --discovery-wait 0.2", "--output", str(tmp_path / "bag")]
    command = [*program("rled_teleop", "record_demos"), *asked, *options]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_TIMEOUT, check=False)
    assert ended.returncode == 0, ended.stderr
    bag = Bag(tmp_path / "bag")
    last_mark = bag.joints(MARKED_JOINT_STATES).stamps[-1]
    statuses = [each for each in bag.records(TASK_STATUS) if isinstance(each, TaskStatus) and each.stamp >= last_mark]
    assert statuses[-1].targets_reached - statuses[0].targets_reached == TARGETS
    (episode,) = review(bag).episodes
    assert [segment.reached for segment in episode.segments] == [True] * TARGETS
