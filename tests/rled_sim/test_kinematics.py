import math

import numpy as np
import pybullet
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import RledError
from rled_sim.kinematics import Chain, solve_position
from rled_sim.robots import ROBOTS, robot_named

QUARTER = math.pi / 2


def one_joint(axis: str, origin: str = "0 0 0", rpy: str = "0 0 0", kind: str = "revolute") -> str:
    return f"""<robot name="one"><link name="base"/><link name="arm"/><link name="tip"/>
    <joint name="turn" type="{kind}"><parent link="base"/><child link="arm"/>
      <origin xyz="{origin}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>
    <joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="1 2 3"/></joint></robot>"""


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_batch_equals_pybullet_over_ten_thousand_configurations(robot):
    q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (10_000, len(robot.joint_names)))
    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(robot.urdf), useFixedBase=True, physicsClientId=client)
    infos = [pybullet.getJointInfo(body, i, client) for i in range(pybullet.getNumJoints(body, client))]
    joints = [next(info[0] for info in infos if info[1].decode() == name) for name in robot.joint_names]
    tip = next(info[0] for info in infos if info[12].decode() == robot.tip_link)
    expected = []
    for row in q:
        for joint, angle in zip(joints, row, strict=True):
            pybullet.resetJointState(body, joint, angle, 0.0, client)
        expected.append(pybullet.getLinkState(body, tip, 0, 1, client)[4])
    pybullet.disconnect(client)
    assert np.abs(robot.chain.position(q) - expected).max() < 1e-6


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ("0 0 1", (-2, 1, 3)),
        ("0 0 -1", (2, -1, 3)),
        ("0 0 5", (-2, 1, 3)),
        ("1 0 0", (1, -3, 2)),
        ("0 1 0", (3, 2, -1)),
        ("0 -1 0", (-3, 2, 1)),
    ],
)
def test_quarter_turn_about_each_axis_by_hand(axis, expected):
    chain = Chain.from_urdf(one_joint(axis), "tip", ("turn",))
    np.testing.assert_allclose(chain.position([QUARTER]), expected, atol=1e-12)


def test_origin_is_roll_then_pitch_then_yaw_about_fixed_axes():
    # (1, 2, 3) rolled by a quarter is (1, -3, 2), pitched by a quarter (2, -3, -1), yawed by a quarter (3, 2, -1)
    chain = Chain.from_urdf(one_joint("0 0 1", "10 20 30", f"{QUARTER} {QUARTER} {QUARTER}"), "tip", ("turn",))
    np.testing.assert_allclose(chain.position([0.0]), (13, 22, 29), atol=1e-12)


def test_oblique_axis_carries_x_to_y_to_z():
    chain = Chain.from_urdf(one_joint("1 1 1"), "tip", ("turn",))
    np.testing.assert_allclose(chain.position([2 * math.pi / 3]), (3, 1, 2), atol=1e-12)


def test_planar_tip_by_trigonometry():
    a, b = 0.3, 0.7
    expected = (0.5 * math.cos(a) + 0.5 * math.cos(a + b), 0.5 * math.sin(a) + 0.5 * math.sin(a + b), 0.1)
    np.testing.assert_allclose(ROBOTS["planar"].chain.position([a, b]), expected, atol=1e-15)


def test_angles_of_half_a_turn_are_exact():
    np.testing.assert_allclose(ROBOTS["planar"].chain.position([math.pi, -math.pi]), (0, 0, 0.1), atol=1e-15)


@given(st.sampled_from(["panda", "planar"]), st.integers(0, 2**32 - 1))
def test_jacobian_equals_finite_differences(name, seed):
    robot, step = ROBOTS[name], 1e-6
    q = np.random.default_rng(seed).uniform(robot.lower, robot.upper)
    differences = [
        (robot.chain.position(q + step * unit) - robot.chain.position(q - step * unit)) / (2 * step)
        for unit in np.eye(len(q))
    ]
    np.testing.assert_allclose(robot.chain.jacobian(q), np.transpose(differences), atol=1e-8)


@pytest.mark.parametrize("shape", [(), (1,), (4, 3), (0,), (2, 0)])
def test_leading_dimensions_are_kept(shape):
    chain = ROBOTS["panda"].chain
    q = np.random.default_rng(0).uniform(-1, 1, (*shape, 7))
    assert chain.position(q).shape == (*shape, 3)
    assert chain.jacobian(q).shape == (*shape, 3, 7)
    if q.size:
        first = q.reshape(-1, 7)[0]
        np.testing.assert_allclose(chain.position(q).reshape(-1, 3)[0], chain.position(first), rtol=0, atol=1e-14)
        np.testing.assert_allclose(chain.jacobian(q).reshape(-1, 3, 7)[0], chain.jacobian(first), atol=1e-15)


@given(st.sampled_from(["panda", "planar"]), st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_one_state_many_states_and_tensors_give_the_same(name, seed, count):
    robot = ROBOTS[name]
    q = np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, len(robot.joint_names)))
    for function in (robot.chain.position, robot.chain.jacobian):
        single = [function(row.tolist()) for row in q]
        np.testing.assert_allclose(function(q), single, rtol=0, atol=1e-14)
        np.testing.assert_allclose(function(torch.from_numpy(q)).numpy(), single, rtol=0, atol=1e-14)
        np.testing.assert_allclose(function(torch.from_numpy(q[0])).numpy(), single[0], rtol=0, atol=1e-14)


def test_tensors_keep_their_type_and_the_derivative_is_the_jacobian():
    robot = ROBOTS["panda"]
    q = torch.tensor(robot.home, dtype=torch.float64)
    derivative = torch.autograd.functional.jacobian(robot.chain.position, q)
    np.testing.assert_allclose(derivative.numpy(), robot.chain.jacobian(robot.home), rtol=0, atol=1e-14)
    single = robot.chain.position(q.float())
    assert single.dtype == torch.float32
    np.testing.assert_allclose(single.numpy(), robot.chain.position(robot.home), atol=1e-6)


def test_rows_do_not_depend_on_the_batch_they_are_in():
    chain = ROBOTS["panda"].chain
    q = np.random.default_rng(0).uniform(-2, 2, (9000, 7))
    whole = chain.position(q)
    for begin, end in ((0, 1), (4095, 4099), (8990, 9000)):
        np.testing.assert_allclose(whole[begin:end], chain.position(q[begin:end]), rtol=0, atol=1e-15)


def test_same_chain_gives_the_same_bits_twice():
    q = np.random.default_rng(0).uniform(-2, 2, (5000, 7))
    assert (ROBOTS["panda"].chain.position(q) == ROBOTS["panda"].chain.position(q)).all()


def test_joints_come_in_the_order_asked_for():
    robot = ROBOTS["planar"]
    swapped = Chain.from_urdf(robot.description, "tip", ("elbow", "shoulder"))
    q = np.array([0.4, 1.1])
    np.testing.assert_allclose(swapped.position(q[::-1]), robot.chain.position(q), atol=1e-15)
    np.testing.assert_allclose(swapped.jacobian(q[::-1])[:, ::-1], robot.chain.jacobian(q), atol=1e-15)


def test_joint_whose_axis_the_tip_lies_on_is_not_computed():
    assert [link.column for link in ROBOTS["panda"].chain.links] == [5, 4, 3, 2, 1, 0]
    assert (ROBOTS["panda"].chain.jacobian(ROBOTS["panda"].home)[:, 6] == 0.0).all()


def test_wrong_number_of_joints_is_refused():
    with pytest.raises(RledError, match=r"shape \(6,\)"):
        ROBOTS["panda"].chain.position(np.zeros(6))


@pytest.mark.parametrize(
    ("text", "tip", "names", "what"),
    [
        ("no xml", "tip", ("turn",), "no URDF"),
        ("<robot><joint name='a'><origin xyz='1 2'/></joint></robot>", "tip", ("turn",), "not three numbers"),
        (one_joint("0 0 1"), "hand", ("turn",), "no link 'hand'"),
        (one_joint("0 0 1"), "tip", ("turn", "twist"), "no revolute joint twist"),
        (one_joint("0 0 1", kind="prismatic"), "tip", ("turn",), "no revolute joint turn"),
        (one_joint("0 0 1", origin="nan 0 0"), "tip", ("turn",), "not three numbers below 1e"),
        (one_joint("0 0 1", origin="1e308 0 0"), "tip", ("turn",), "not three numbers below 1e"),
        (
            one_joint("0 0 1").replace('"end" type="fixed"', '"turn" type="revolute"'),
            "tip",
            ("turn",),
            "joints of one name",
        ),
    ],
)
def test_bad_robot_descriptions_are_refused(text, tip, names, what):
    with pytest.raises(RledError, match=what):
        Chain.from_urdf(text, tip, names)


def test_unknown_robot_names_the_known_ones():
    with pytest.raises(RledError, match="unknown robot 'ur5'; accepted: panda, planar"):
        robot_named("ur5")


def test_limits_come_from_the_urdf():
    assert ROBOTS["panda"].lower[3] == -3.1416
    assert ROBOTS["panda"].upper[3] == 0.0
    assert ROBOTS["planar"].lower == (-math.pi, 0.0)
    assert ROBOTS["planar"].upper == (math.pi, 3.0)


@given(st.sampled_from(["panda", "planar"]), st.integers(0, 2**32 - 1))
def test_inverse_brings_the_tip_to_where_it_can_be(name, seed):
    robot, rng = ROBOTS[name], np.random.default_rng(seed)
    target = robot.chain.position(rng.uniform(robot.lower, robot.upper))
    q = solve_position(robot.chain, target, robot.home, robot.lower, robot.upper)
    assert np.linalg.norm(robot.chain.position(q) - target) <= 1e-4
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()


def test_inverse_from_the_solution_stays_there():
    robot = ROBOTS["panda"]
    q = solve_position(robot.chain, robot.chain.position(robot.home), robot.home, robot.lower, robot.upper)
    assert q.tolist() == list(robot.home)


def test_planar_inverse_equals_the_closed_form():
    robot = ROBOTS["planar"]
    elbow = 2 * math.acos(0.6)  # the tip is 0.6 m away when cos(elbow / 2) is 0.6
    target = (0.6 * math.cos(0.4), 0.6 * math.sin(0.4), 0.1)
    q = solve_position(robot.chain, target, robot.home, robot.lower, robot.upper, tolerance=1e-9)
    np.testing.assert_allclose(q, (0.4 - elbow / 2, elbow), atol=1e-6)


def test_inverse_leaves_a_singular_start():
    robot = ROBOTS["planar"]
    q = solve_position(robot.chain, (0.5, 0.0, 0.1), (0.0, 0.0), robot.lower, robot.upper)
    assert np.linalg.norm(robot.chain.position(q) - (0.5, 0.0, 0.1)) <= 1e-4


@pytest.mark.parametrize(("name", "target"), [("panda", (2.0, 0.0, 0.5)), ("planar", (0.8, 0.0, 0.3))])
def test_point_out_of_reach_is_refused(name, target):
    robot = ROBOTS[name]
    with pytest.raises(RledError, match="out of reach: the nearest found is"):
        solve_position(robot.chain, target, robot.home, robot.lower, robot.upper)
