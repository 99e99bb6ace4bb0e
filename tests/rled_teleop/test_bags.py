"""The bags that come with the project."""

from pathlib import Path

import numpy as np
import pytest
from rled_msgs_py.bags import Bag
from rled_msgs_py.topics import JOINT_DELTA, MARKED_EE_POSE, MARKED_JOINT_STATES
from rled_sim.kinematics import Chain
from rled_sim.robots import robot_named
from rled_sim.tasks import reach_task
from rled_teleop.recording.summary import summarise

BAGS = Path(__file__).parents[2] / "bags"
ROBOTS = {"panda_lemniscate": "panda", "planar_lemniscate": "planar"}


@pytest.fixture(params=ROBOTS)
def bag(request: pytest.FixtureRequest) -> Bag:
    return Bag(BAGS / request.param)


def test_a_bag_is_of_the_robot_and_the_task_of_today(bag: Bag) -> None:
    robot = robot_named(ROBOTS[bag.path.name])
    assert bag.robot_description == robot.description
    assert bag.task == reach_task(robot, targets_per_episode=0, max_steps=0).description


def test_a_bag_holds_all_points_of_the_curve(bag: Bag) -> None:
    targets = reach_task(robot_named(bag.task.robot)).targets
    poses, joints = bag.poses(MARKED_EE_POSE), bag.joints(MARKED_JOINT_STATES)
    np.testing.assert_allclose(poses.position, targets, atol=2e-4)
    chain = Chain.from_urdf(bag.robot_description, bag.task.tip_link, bag.task.joint_names)
    np.testing.assert_allclose(chain.position(joints.ordered(bag.task.joint_names).position), targets, atol=2e-4)


def test_a_bag_holds_what_its_readme_says(bag: Bag) -> None:
    line = next(line for line in (BAGS / "README.md").read_text().splitlines() if f"| `{bag.path.name}`" in line)
    summary = summarise(bag.path)
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    said = [str(summary.points), str(summary.trajectories), str(summary.states), f"{summary.seconds:.2f} s"]
    assert cells[2:6] == said
    assert f"--points {summary.points} --trajectories {summary.trajectories}" in cells[6]
    assert (summary.unanswered, summary.lost) == (0, 0)


def test_no_displacement_of_a_bag_exceeds_max_delta(bag: Bag) -> None:
    assert np.abs(bag.joints(JOINT_DELTA).position).max() <= bag.task.max_delta


def test_a_bag_is_small(bag: Bag) -> None:
    assert sum(file.stat().st_size for file in bag.path.iterdir()) < 3_000_000
