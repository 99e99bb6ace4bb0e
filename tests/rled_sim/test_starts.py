import numpy as np
import pytest
from rled_msgs_py.bags import BagWriter
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import JointSample, Text
from rled_msgs_py.topics import MARKED_JOINT_STATES, ROBOT_DESCRIPTION, TASK_DESCRIPTION
from rled_sim.robots import ROBOTS
from rled_sim.sim_params import SimParams, simulation_of
from rled_sim.starts import marked_joints
from rled_sim.tasks import reach_task

TASK = reach_task(ROBOTS["planar"]).description
POINTS = np.array([(-0.5, 1.2), (-0.7, 1.5), (-0.9, 1.1)])


def bag_with(path, points, names=("shoulder", "elbow"), robot="planar"):
    with BagWriter(path) as bag:
        bag.write(ROBOT_DESCRIPTION, Text(ROBOTS[robot].description))
        bag.write(TASK_DESCRIPTION, Text(reach_task(ROBOTS[robot]).description.to_json()))
        for stamp, point in enumerate(points):
            bag.write(MARKED_JOINT_STATES, JointSample(stamp, names, point, np.zeros(len(names))))
    return path


def test_marked_points_are_read_in_the_robots_joint_order(tmp_path):
    bag = bag_with(tmp_path / "bag", POINTS[:, ::-1], names=("elbow", "shoulder"))
    np.testing.assert_array_equal(marked_joints(bag, TASK), POINTS)


def test_episodes_start_at_the_points_of_the_bag(tmp_path):
    bag = bag_with(tmp_path / "bag", POINTS)
    simulation = simulation_of(SimParams(robot="planar", start_points=str(bag)))
    rng, seen = np.random.default_rng(0), set()
    for _ in range(50):
        simulation.reset(rng)
        seen.add(tuple(simulation.plant.q))
    simulation.plant.close()
    assert seen == set(map(tuple, POINTS.tolist()))


def test_bag_of_another_robot_is_refused(tmp_path):
    with pytest.raises(RledError, match="is for robot panda; accepted: planar"):
        marked_joints(bag_with(tmp_path / "bag", [], robot="panda"), TASK)


def test_bag_without_marked_points_is_refused(tmp_path):
    with pytest.raises(RledError, match="no marked points"):
        marked_joints(bag_with(tmp_path / "bag", []), TASK)


def test_missing_bag_is_refused(tmp_path):
    with pytest.raises(RledError, match="nowhere"):
        marked_joints(tmp_path / "nowhere", TASK)


def test_parameters_make_the_task():
    simulation = simulation_of(SimParams(robot="planar", reward="sparse", targets_per_episode=0, period=0.01))
    simulation.plant.close()
    task = simulation.task.description
    assert (task.reward, task.targets_per_episode, task.max_steps, task.period) == ("sparse", 0, 100, 10_000_000)
