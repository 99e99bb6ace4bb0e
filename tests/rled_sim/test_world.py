import math
from itertools import pairwise

import numpy as np
import pybullet
import pytest
from rled_msgs_py.errors import RledError
from rled_sim.bullet.world import World
from rled_sim.plant import Contact
from rled_sim.robots import ROBOTS

PERIOD = 0.02


@pytest.fixture
def world(request):
    robot, transition = request.param
    made = World(ROBOTS[robot], transition, PERIOD)
    yield made
    made.close()


both = pytest.mark.parametrize("world", [("panda", "kinematic"), ("planar", "kinematic")], indirect=True)
panda = pytest.mark.parametrize("world", [("panda", "kinematic")], indirect=True)
motors = pytest.mark.parametrize("world", [("panda", "motors")], indirect=True)


@both
def test_displaced_joints_are_the_sum_and_the_tip_follows(world):
    q, delta = np.array(world.q), np.full(len(world.q), 0.03)
    world.move(delta.tolist())
    assert world.q == (q + delta).tolist()
    chain = ROBOTS["panda" if len(q) == 7 else "planar"].chain
    np.testing.assert_allclose(world.position, chain.position(world.q), atol=1e-6)


@both
def test_displaced_joints_stop_at_their_limits(world):
    robot = ROBOTS["panda" if len(world.q) == 7 else "planar"]
    world.move([10.0] * len(world.q))
    assert tuple(world.q) == robot.upper
    world.move([-20.0] * len(world.q))
    assert tuple(world.q) == robot.lower


@both
def test_velocity_is_the_displacement_over_the_period(world):
    assert world.velocity == [0.0] * len(world.q)
    world.move([0.03, -0.01] + [0.0] * (len(world.q) - 2))
    np.testing.assert_allclose(world.velocity[:2], (1.5, -0.5), atol=1e-12)
    world.move([0.0] * len(world.q))
    assert world.velocity == [0.0] * len(world.q)


@both
def test_placed_robot_is_at_rest_wherever_it_was(world):
    world.move([0.04] * len(world.q))
    world.place(list(world.robot.home))
    assert world.q == list(world.robot.home)
    assert world.velocity == [0.0] * len(world.q)


@panda
def test_tool_of_the_home_pose_points_down(world):
    x, y, z, w = world.orientation
    down = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))  # the tool's z axis in the world
    assert math.hypot(*world.orientation) == pytest.approx(1.0)
    assert down[2] < -0.9


@panda
def test_only_what_touches_is_reported(world):
    assert world.contacts() == []
    world.place([0.0, 1.8, 0.0, -0.9, 0.0, 1.5, 0.785])
    assert {contact.other for contact in world.contacts()} == {"floor"}


@panda
def test_contact_begins_where_the_distance_ends(world):
    def distance():
        points = pybullet.getClosestPoints(
            world._body.number, world._body.floor, 0.2, physicsClientId=world._client.number
        )
        return min((point[8] for point in points if point[3] >= 0), default=1.0)

    pose = [0.0, 1.2, 0.0, -0.9, 0.0, 1.5, 0.785]
    while not world.contacts():
        above = distance()
        pose[1] += 0.001
        world.place(pose)
    assert 0.0 < above < 0.003
    assert distance() < 0.001


@panda
def test_folded_arm_touches_itself(world):
    world.place([0.0, -1.7, 0.0, -3.1, 0.0, -0.05, 0.0])
    assert any(contact.other != "floor" for contact in world.contacts())


@motors
def test_motors_hold_against_gravity(world):
    for _ in range(100):
        world.move([0.0] * 7)
    np.testing.assert_allclose(world.q, list(world.robot.home), atol=1e-3)


@motors
def test_motors_follow_the_displacements(world):
    delta = [0.02, 0.01, -0.02, 0.02, 0.0, 0.01, -0.01]
    for _ in range(20):
        world.move(delta)
    for _ in range(20):
        world.move([0.0] * 7)
    np.testing.assert_allclose(world.q, np.add(list(world.robot.home), np.multiply(delta, 20)), atol=0.01)


@motors
def test_motors_keep_the_velocity_limits(world):
    fastest = np.zeros(7)
    for _ in range(40):
        world.move([0.5, 0.0, 0.5, 0.0, 0.5, 0.0, 0.5])
        fastest = np.maximum(fastest, np.abs(world.velocity))
    limits = np.array([joint.velocity for joint in ROBOTS["panda"].joints])
    assert (fastest <= 1.05 * limits).all()
    assert fastest[0] > 0.5 * limits[0]


@motors
def test_floor_stops_the_motors_and_is_reported(world):
    assert world.contacts() == []
    lowest = world.position[2]
    for _ in range(80):
        world.move([0.0, 0.04, 0.0, 0.0, 0.0, 0.0, 0.0])
        lowest = min(lowest, world.position[2])
    assert "floor" in {contact.other for contact in world.contacts()}
    assert isinstance(world.contacts()[0], Contact)
    assert lowest > -0.02


@motors
def test_blocked_joint_does_not_wind_up(world):
    for _ in range(150):
        world.move([0.0, 0.04, 0.0, 0.0, 0.0, 0.0, 0.0])
    blocked = world.q[1]
    for _ in range(25):
        world.move([0.0, -0.04, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert world.q[1] < blocked - 0.5


@motors
def test_halted_motors_do_not_go_on_to_their_set_point(world):
    for _ in range(20):
        world.move([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    halted = world.q[0]
    world.halt()
    for _ in range(10):
        world.move([0.0] * 7)
    assert abs(world.q[0] - halted) < 0.005
    assert abs(world.velocity[0]) < 1e-3


@panda
def test_picture_shows_the_true_pose_and_the_target(world):
    world.show_target((0.5, 0.3, 0.5))
    first = world.picture()
    assert first.shape == (480, 640, 3)
    assert first.dtype == np.uint8
    red = (first[..., 0] > 120) & (first[..., 1] < 60)
    assert red.any()
    for _ in range(10):
        world.move([0.04] * 7)
    assert (world.picture() != first).any()


def test_two_worlds_do_not_meet():
    with_motion, still = (World(ROBOTS["panda"], "kinematic", PERIOD) for _ in range(2))
    with_motion.move([0.04] * 7)
    assert still.q == list(still.robot.home)
    with_motion.close()
    still.move([0.01] * 7)
    still.close()
    still.close()


def test_window_without_a_display_is_refused(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(RledError, match="no display"):
        World(ROBOTS["panda"], "kinematic", PERIOD, gui=True)


@pytest.mark.parametrize("transition", ["kinematic", "motors"])
def test_same_displacements_give_the_same_bits(transition):
    tracks = []
    for _ in range(2):
        world, rng, track = World(ROBOTS["panda"], transition, PERIOD), np.random.default_rng(5), []
        for _ in range(50):
            world.move(rng.uniform(-0.04, 0.04, 7).tolist())
            track.append((*world.q, *world.velocity, *world.position, *world.orientation))
        world.close()
        tracks.append(track)
    assert tracks[0] == tracks[1]
    assert all(before != after for before, after in pairwise(tracks[0]))
