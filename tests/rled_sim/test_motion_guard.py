"""The guard by hand. The planar arm has links of 0.5 m: stretched out at angle a, its tip is at (cos a, sin a, 0.1)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import RledError
from rled_msgs_py.task_limits import Limits, Zone
from rled_sim.commands import Code
from rled_sim.motion_guard import Guard, depth
from rled_sim.plant import Contact
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

PLANAR = ROBOTS["planar"]
TASK = reach_task(PLANAR).description  # Δq_max 0.1 rad, period 20 ms
STILL = (0.0, 0.0)
STRAIGHT = (0.0, 0.0)  # tip at (1, 0, 0.1)


def guard(touches=None, **limits):
    return Guard(replace(TASK, limits=Limits(**limits)), PLANAR.chain, touches)


def code(judge, q, delta, previous=STILL):
    refused = judge.judge(q, previous, delta)
    return None if refused is None else refused.code


def test_without_limits_only_the_size_counts():
    free = guard()
    assert code(free, (100.0, -100.0), (0.1, -0.1)) is None
    assert code(free, STRAIGHT, (float(np.float32(0.1)), 0.0)) is None
    assert code(free, STRAIGHT, (0.0, -0.1001)) is Code.TOO_LARGE


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("which", range(3))
def test_what_is_no_number_is_refused_in_each_of_the_vectors(bad, which):
    vectors = [[0.0, 0.0], [0.0, 0.0], [0.01, 0.0]]
    vectors[which][0] = bad
    assert guard().judge(*vectors).code is Code.UNREADABLE


def test_vectors_of_another_shape_are_an_error():
    with pytest.raises(RledError, match=r"delta of shape \(3,\); accepted: \(2,\)"):
        guard().judge(STRAIGHT, STILL, np.zeros(3))


def test_end_effector_is_not_judged_without_kinematics():
    with pytest.raises(RledError, match="limits of the end effector"):
        Guard(replace(TASK, limits=Limits(tip_lower=(0.0,) * 3, tip_upper=(1.0,) * 3)))


class TestJointRange:
    judge = guard(joint_lower=(-1.0, 0.0), joint_upper=(1.0, 2.0))

    def test_up_to_the_limit_is_lawful_and_beyond_is_not(self):
        assert code(self.judge, (0.95, 1.0), (0.05, 0.0)) is None
        assert code(self.judge, (0.95, 1.0), (0.0501, 0.0)) is Code.JOINT_RANGE
        assert code(self.judge, (0.0, 0.05), (0.0, -0.06)) is Code.JOINT_RANGE

    def test_joint_and_range_are_named(self):
        refused = self.judge.judge((0.95, 1.0), STILL, (0.1, 0.0))
        assert str(refused) == "shoulder would be at 1.05 rad; accepted: -1 to 1 rad"

    def test_from_outside_only_the_way_back_is_lawful(self):
        assert code(self.judge, (1.5, 1.0), (-0.1, 0.0)) is None
        assert code(self.judge, (1.5, 1.0), (0.0, 0.1)) is None
        assert code(self.judge, (1.5, 1.0), (0.001, 0.0)) is Code.JOINT_RANGE


def test_velocity_is_the_displacement_over_the_period():
    judge = guard(velocity=(2.0, 6.0))  # 0.04 rad in 20 ms are 2 rad/s
    assert code(judge, STRAIGHT, (0.04, 0.1)) is None
    assert code(judge, STRAIGHT, (float(np.float32(0.04)), 0.0)) is None
    assert code(judge, STRAIGHT, (-0.0401, 0.0)) is Code.VELOCITY


class TestAcceleration:
    judge = guard(acceleration=(25.0, 25.0))  # 0.01 rad more in each period of 20 ms

    def test_speeding_up_is_limited(self):
        assert code(self.judge, STRAIGHT, (0.01, -0.01)) is None
        assert code(self.judge, STRAIGHT, (0.0101, 0.0)) is Code.ACCELERATION
        assert code(self.judge, STRAIGHT, (0.06, 0.0), previous=(0.05, 0.0)) is None
        assert code(self.judge, STRAIGHT, (0.0601, 0.0), previous=(0.05, 0.0)) is Code.ACCELERATION

    def test_braking_is_not(self):
        assert code(self.judge, STRAIGHT, (0.001, 0.0), previous=(0.05, 0.0)) is None

    def test_turning_back_is_speeding_up_the_other_way(self):
        assert code(self.judge, STRAIGHT, (-0.01, 0.0), previous=(0.05, 0.0)) is None
        assert code(self.judge, STRAIGHT, (-0.0101, 0.0), previous=(0.05, 0.0)) is Code.ACCELERATION


class TestWorkspace:
    judge = guard(tip_lower=(-2.0, -0.5, 0.0), tip_upper=(2.0, 0.5, 1.0))

    def test_tip_stays_in_the_box(self):
        low = math.asin(0.5) - 0.05  # a straight arm's tip is at y = sin a
        assert code(self.judge, (low, 0.0), (0.04, 0.0)) is None
        assert code(self.judge, (low, 0.0), (0.06, 0.0)) is Code.WORKSPACE

    def test_from_outside_only_the_way_back_is_lawful(self):
        assert code(self.judge, (1.0, 0.0), (-0.1, 0.0)) is None
        assert code(self.judge, (1.0, 0.0), (0.1, 0.0)) is Code.WORKSPACE


class TestKeepOut:
    def test_tip_stays_out(self):
        judge = guard(keep_out=(Zone("sphere", (0.0, 1.0, 0.1), (0.1,)),))
        # the tip of a straight arm at angle a is 2 sin(|pi / 2 - a| / 2) from (0, 1): 0.1 m at 0.10004 rad
        assert code(judge, (math.pi / 2 - 0.15, 0.0), (0.04, 0.0)) is None
        assert code(judge, (math.pi / 2 - 0.15, 0.0), (0.06, 0.0)) is Code.KEEP_OUT
        refused = judge.judge((math.pi / 2 - 0.15, 0.0), STILL, (0.06, 0.0))
        assert "a keep-out sphere at (0.090, 0.996, 0.100) m" in str(refused)

    def test_thin_zone_is_not_leapt_over(self):
        judge = guard(keep_out=(Zone("cylinder", (1.0, 0.05, 0.0), (0.01, 1.0)),))
        assert code(judge, STRAIGHT, (0.1, 0.0)) is Code.KEEP_OUT  # ends at (0.995, 0.0998), well behind it

    def test_from_within_only_the_way_out_is_lawful(self):
        judge = guard(keep_out=(Zone("box", (1.0, 0.0, 0.1), (0.2, 0.2, 0.2)),))
        assert code(judge, (0.05, 0.0), (0.1, 0.0)) is None
        assert code(judge, (0.05, 0.0), (-0.02, 0.0)) is Code.KEEP_OUT


@pytest.mark.parametrize(
    ("zone", "point", "deep"),
    [
        (Zone("sphere", (1.0, 0.0, 0.0), (0.5,)), (1.0, 0.3, 0.4), 0.0),
        (Zone("sphere", (1.0, 0.0, 0.0), (0.5,)), (1.0, 0.0, 0.1), 0.4),
        (Zone("box", (0.0, 0.0, 0.0), (2.0, 4.0, 6.0)), (0.5, 1.8, 0.0), 0.2),
        (Zone("box", (0.0, 0.0, 0.0), (2.0, 4.0, 6.0)), (0.0, 0.0, 3.5), -0.5),
        (Zone("cylinder", (0.0, 0.0, 1.0), (1.0, 0.6)), (0.6, 0.0, 1.0), 0.3),
        (Zone("cylinder", (0.0, 0.0, 1.0), (1.0, 0.6)), (0.6, 0.64, 1.2), 0.1),
        (Zone("cylinder", (0.0, 0.0, 1.0), (1.0, 0.6)), (3.0, 4.0, 1.0), -4.0),
    ],
)
def test_depth_in_a_zone_by_hand(zone, point, deep):
    assert depth(zone, point) == pytest.approx(deep, abs=1e-12)


class TestCollisions:
    """A made-up robot whose elbow digs into the floor beyond 1 rad, and which has always touched itself."""

    @staticmethod
    def touches(q):
        deep = {Contact("forearm", "base"): 0.01}
        return deep | {Contact("forearm", "floor"): q[1] - 1.0} if q[1] > 1.0 else deep

    judge = guard(touches.__func__, collisions=True)

    def test_new_contact_is_refused_and_named(self):
        refused = self.judge.judge((0.0, 0.95), STILL, (0.0, 0.1))
        assert refused.code is Code.CONTACT
        assert "forearm would touch floor" in str(refused)

    def test_known_contact_may_stay_but_not_deepen(self):
        assert code(self.judge, (0.0, 0.5), (0.1, 0.0)) is None
        assert code(self.judge, (0.0, 1.05), (0.1, 0.0)) is None
        assert code(self.judge, (0.0, 1.05), (0.0, -0.01)) is None
        assert code(self.judge, (0.0, 1.05), (0.0, 0.01)) is Code.CONTACT

    def test_another_link_is_a_collision_with_itself(self):
        judge = guard(lambda q: {Contact("forearm", "base"): max(q[0], 0.0)}, collisions=True)
        assert code(judge, (0.0, 0.0), (0.1, 0.0)) is Code.SELF_COLLISION

    def test_whoever_cannot_tell_leaves_them_to_others(self):
        assert code(guard(collisions=True), (0.0, 1.0), (0.0, 0.1)) is None


EVERYTHING = guard(
    lambda q: {Contact("forearm", "floor"): 1.0},
    joint_lower=(-1.0, 0.5),
    joint_upper=(1.0, 2.0),
    velocity=(3.0, 3.0),
    acceleration=(50.0, 50.0),
    tip_lower=(0.3, -0.5, 0.0),
    tip_upper=(0.9, 0.5, 1.0),
    keep_out=(Zone("sphere", (0.6, 0.2, 0.1), (0.1,)), Zone("box", (0.5, -0.3, 0.1), (0.1, 0.2, 1.0))),
    collisions=True,
)
ANGLES = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
STEPS = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1))


@given(ANGLES, STEPS)
def test_to_stand_still_is_always_lawful(q, previous):
    assert EVERYTHING.judge(q, previous, STILL) is None


@given(st.lists(STEPS, min_size=1, max_size=60))
def test_lawful_motion_never_leaves_the_limits(steps):
    limits = EVERYTHING._limits
    q, previous = np.array(PLANAR.home), np.zeros(2)
    for step in map(np.array, steps):
        if EVERYTHING.judge(q, previous, step) is not None:
            step = np.zeros(2)
        q, previous = q + step, step
        assert (np.array(limits.joint_lower) - 1e-6 <= q).all()
        assert (q <= np.array(limits.joint_upper) + 1e-6).all()
        tip = PLANAR.chain.position(q)
        assert (np.array(limits.tip_lower) - 1e-6 <= tip).all()
        assert (tip <= np.array(limits.tip_upper) + 1e-6).all()
        assert all(depth(zone, tip) < 1e-6 for zone in limits.keep_out)
        assert (np.abs(step) <= 3.0 * 0.02 * (1 + 1e-5)).all()
