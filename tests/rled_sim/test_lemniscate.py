import numpy as np
from rled_sim.lemniscate import lemniscate
from rled_sim.robots import ROBOTS
from rled_sim.tasks import reach_task

CURVE = lemniscate(8, centre=(1.0, 2.0, 3.0), along=(0.0, 0.5, 0.0), across=(0.0, 0.0, 0.5))


def test_eight_points_by_hand():
    # t = 0: cos 1, sin 0; t = pi/4: cos = sin = 1/sqrt 2, so 1 + sin^2 = 3/2; t = pi/2: the double point
    lobe, height = 0.5 * (2**-0.5 / 1.5), 0.5 * (0.5 / 1.5)
    np.testing.assert_allclose(CURVE[0], (1.0, 2.5, 3.0), atol=1e-15)
    np.testing.assert_allclose(CURVE[1], (1.0, 2.0 + lobe, 3.0 + height), atol=1e-15)
    np.testing.assert_allclose(CURVE[2], (1.0, 2.0, 3.0), atol=1e-15)
    np.testing.assert_allclose(CURVE[3], (1.0, 2.0 - lobe, 3.0 - height), atol=1e-15)
    np.testing.assert_allclose(CURVE[4], (1.0, 1.5, 3.0), atol=1e-15)
    np.testing.assert_allclose(CURVE[7], (1.0, 2.0 + lobe, 3.0 - height), atol=1e-15)


def test_every_point_solves_the_implicit_equation():
    # (x^2 + y^2)^2 = a^2 (x^2 - y^2)
    _, x, y = (lemniscate(501, (0, 0, 0), (0, 0.25, 0), (0, 0, 0.25))).T
    np.testing.assert_allclose((x**2 + y**2) ** 2, 0.25**2 * (x**2 - y**2), atol=1e-15)


def test_panda_targets_are_1572_points_across_its_front():
    targets = reach_task(ROBOTS["panda"]).targets
    assert targets.shape == (1572, 3)
    assert (targets[:, 0] == 0.5).all()
    np.testing.assert_allclose(targets[0], (0.5, 0.25, 0.5), atol=1e-15)
    np.testing.assert_allclose(np.abs(targets[:, 2] - 0.5).max(), 0.25 / 8**0.5, atol=1e-6)


def test_planar_targets_lie_in_the_plane_of_its_tip():
    robot = ROBOTS["planar"]
    targets = reach_task(robot).targets
    assert targets.shape == (400, 3)
    assert (targets[:, 2] == robot.chain.position(robot.home)[2]).all()
    np.testing.assert_allclose(targets[0], (0.65, 0.25, 0.1), atol=1e-15)
