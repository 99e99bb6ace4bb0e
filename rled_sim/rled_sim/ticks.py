"""The state of a simulation as the records that are published."""

import numpy as np
from rled_msgs_py.records import JointSample, PoseSample, TaskStatus
from rled_msgs_py.tick import Tick

from rled_sim.simulation import Simulation


def tick_of(simulation: Simulation, stamp: int, number: int, reward: float) -> Tick:
    """The tick of a simulation's present state.

    Args:
        simulation: the simulation.
        stamp: simulation time (ns).
        number: episodes begun before this one.
        reward: of the transition that led here; 0 when none did.
    """
    plant, episode, task = simulation.plant, simulation.episode, simulation.task.description
    return Tick(
        JointSample(stamp, task.joint_names, np.array(plant.q), np.array(plant.velocity)),
        PoseSample(stamp, task.frame, np.array(plant.position), np.array(plant.orientation)),
        PoseSample(stamp, task.frame, np.array(episode.target)),
        TaskStatus(
            stamp=stamp,
            episode=number,
            step=episode.steps,
            reward=reward,
            targets_reached=episode.targets_reached,
            risky=episode.risky,
            violations=episode.violations,
            terminated=episode.outcome.terminated,
            truncated=episode.outcome.truncated,
            refused=simulation.refused.name if simulation.refused else "",
        ),
    )
