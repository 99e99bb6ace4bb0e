"""What the node's parameters say of limits, time and starts."""

import numpy as np
import pytest
from rled_msgs_py.bags import BagWriter
from rled_msgs_py.errors import RledError
from rled_msgs_py.records import JointSample, Text
from rled_msgs_py.task_limits import NO_LIMITS, Zone
from rled_msgs_py.topics import MARKED_JOINT_STATES, ROBOT_DESCRIPTION, TASK_DESCRIPTION
from rled_sim.robots import ROBOTS
from rled_sim.sim_params import SimParams, limits_of, simulation_of
from rled_sim.starts import marked_joints
from rled_sim.tasks import reach_task

PLANAR = ROBOTS["planar"]


def test_no_limit_is_on_by_default():
    assert limits_of(SimParams(), PLANAR) == NO_LIMITS


def test_limits_are_those_of_the_robot_and_what_is_said():
    limits = limits_of(
        SimParams(joint_margin=0.25, velocity_share=0.5, acceleration=20.0, collisions=True), PLANAR
    )  # elbow 0 to 3 rad, 6 rad/s
    assert (limits.joint_lower[1], limits.joint_upper[1]) == (0.25, 2.75)
    assert limits.velocity == (3.0, 3.0)
    assert limits.acceleration == (20.0, 20.0)
    assert limits.collisions


def test_workspace_and_zones_are_written_as_words():
    params = SimParams(
        workspace="-1 -1 0  1 1 1.5", keep_out="sphere 0.5 0 0.3 0.1; box 0 0 0 1 2 3 ;cylinder 0.4 0 0.5 0.1 1;"
    )
    limits = limits_of(params, PLANAR)
    assert (limits.tip_lower, limits.tip_upper) == ((-1.0, -1.0, 0.0), (1.0, 1.0, 1.5))
    assert limits.keep_out == (
        Zone("sphere", (0.5, 0.0, 0.3), (0.1,)),
        Zone("box", (0.0, 0.0, 0.0), (1.0, 2.0, 3.0)),
        Zone("cylinder", (0.4, 0.0, 0.5), (0.1, 1.0)),
    )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"workspace": "0 0 0 1 1"}, "tip_lower"),
        ({"workspace": "0 0 0 1 1 nan"}, "finite"),
        ({"workspace": "0 0 0 1 1 high"}, "numbers of '0 0 0 1 1 high'"),
        ({"keep_out": "cone 0 0 0 1"}, "accepted: box, sphere, cylinder"),
        ({"keep_out": "sphere 0 0"}, "centre"),
        ({"keep_out": "sphere 0 0 0 1 1"}, "size of a sphere"),
        ({"joint_margin": 1.0, "keep_out": "sphere 0 0 0 -1"}, "more than 0"),
    ],
)
def test_limits_that_cannot_be_read_are_refused(given, said):
    with pytest.raises(RledError, match=said):
        limits_of(SimParams(**given), PLANAR)


def test_a_command_may_be_two_periods_late_unless_said_otherwise():
    assert SimParams().rules().command_timeout == 40_000_000
    assert SimParams(period=0.002).rules().command_timeout == 4_000_000
    assert SimParams(command_timeout=0.5).rules().command_timeout == 500_000_000


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
