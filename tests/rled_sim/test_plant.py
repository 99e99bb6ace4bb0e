"""Another plant than PyBullet's world does as well."""

import numpy as np
import pytest
from rled_msgs_py.task_limits import Limits
from rled_sim.bullet.world import World
from rled_sim.plant import Contact, Plant
from rled_sim.robots import ROBOTS
from rled_sim.simulation import Simulation
from rled_sim.tasks import reach_task

from rled_sim import ENVIRONMENTS

PERIOD = 0.02


class KinematicPlant:
    """Eq. 4.28 with the kinematics of the project; PyBullet has no part in it."""

    physical = False
    orientation = (0.0, 0.0, 0.0, 1.0)

    def __init__(self, robot):
        self.robot = robot
        self.closed = False
        self.place(robot.home)

    def place(self, q):
        self.q, self.velocity = list(q), [0.0] * len(q)

    def move(self, delta):
        before = self.q
        self.q = np.clip(np.add(before, delta), self.robot.lower, self.robot.upper).tolist()
        self.velocity = (np.subtract(self.q, before) / PERIOD).tolist()

    @property
    def set_point(self):
        return self.q

    @property
    def position(self):
        return tuple(self.robot.chain.position(self.q).tolist())

    def halt(self):
        pass

    def contacts(self):
        return []

    def touches(self, q):
        return {Contact("arm", "floor"): 0.01} if q[1] > 1.9 else {}

    def close(self):
        self.closed = True


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_another_plant_gives_the_same_transitions(name):
    robot = ROBOTS[name]
    task = reach_task(
        robot, targets_per_episode=0, max_steps=0, limits=Limits(velocity=(45 * robot.max_delta,) * len(robot.home))
    )
    world = World(robot, "kinematic", PERIOD)
    plants: tuple[Plant, ...] = (world, KinematicPlant(robot))
    simulations = [Simulation(plant, task) for plant in plants]
    for simulation in simulations:
        simulation.reset(np.random.default_rng(0))
    refused = 0
    for delta in np.random.default_rng(1).uniform(-robot.max_delta, robot.max_delta, (300, len(robot.home))).tolist():
        ours, theirs = (simulation.step(delta) for simulation in simulations)
        assert ours.reward == pytest.approx(theirs.reward, abs=1e-5)
        assert ours[1:] == theirs[1:]
        bullet, plain = (simulation.plant for simulation in simulations)
        assert bullet.q == plain.q
        np.testing.assert_allclose(bullet.velocity, plain.velocity, atol=1e-12)
        np.testing.assert_allclose(bullet.position, plain.position, atol=1e-6)
        assert len({each.refused is None for each in simulations}) == 1
        refused += simulations[0].refused is not None
    assert len({each.episode.target for each in simulations}) == 1
    assert [each.episode.violations for each in simulations] == [simulations[0].episode.violations] * 2
    assert refused
    world.close()


def test_the_limits_ask_the_plant_what_would_touch():
    robot = ROBOTS["planar"]
    simulation = Simulation(KinematicPlant(robot), reach_task(robot, limits=Limits(collisions=True)))
    simulation.reset(np.random.default_rng(0))
    simulation.step([0.0, 0.05])
    assert simulation.refused is None
    simulation.step([0.0, 0.08])
    assert simulation.refused.name == "contact"
    assert simulation.plant.q[1] == pytest.approx(1.85)
