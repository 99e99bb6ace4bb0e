"""Observations and actions in the units that networks see (4.1.3: both are normalised)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scaling:
    """An affine map of observations and actions to about [−1, 1].

    Attributes:
        observation_center: physical observation that maps to 0, shape (o,).
        observation_scale: physical distance that maps to 1, shape (o,), positive.
        action_center: physical action that maps to 0 (rad), shape (n,).
        action_scale: physical distance that maps to 1 (rad), shape (n,), positive.
    """

    observation_center: Floats
    observation_scale: Floats
    action_center: Floats
    action_scale: Floats

    def normalize_observation(self, observation: NDArray[np.floating]) -> NDArray[np.float32]:
        """Observation as networks see it, shape (..., o)."""
        return ((observation - self.observation_center) / self.observation_scale).astype(np.float32)

    def denormalize_observation(self, observation: NDArray[np.floating]) -> Floats:
        """Physical observation of one as networks see it, shape (..., o)."""
        return self.observation_center + self.observation_scale * observation

    def normalize_action(self, action: NDArray[np.floating]) -> NDArray[np.float32]:
        """Action in [−1, 1], shape (..., n)."""
        return ((action - self.action_center) / self.action_scale).astype(np.float32)

    def denormalize_action(self, action: NDArray[np.floating]) -> Floats:
        """Physical action (rad) of one in [−1, 1], shape (..., n)."""
        return self.action_center + self.action_scale * action


def scaling_of_bounds(observation: tuple[Floats, Floats], action: tuple[Floats, Floats]) -> Scaling:
    """The map that takes bounds to [−1, 1]; an unbounded observation component is left as it is.

    Raises:
        RledError: an action component is unbounded.
    """
    low, high = (np.asarray(bound, dtype=np.float64) for bound in observation)
    bounded = np.isfinite(low) & np.isfinite(high) & (high > low)
    center = np.where(bounded, (np.where(bounded, low, 0) + np.where(bounded, high, 0)) / 2, 0.0)
    scale = np.where(bounded, (np.where(bounded, high, 1) - np.where(bounded, low, -1)) / 2, 1.0)
    action_low, action_high = (np.asarray(bound, dtype=np.float64) for bound in action)
    if not (np.isfinite(action_low).all() and np.isfinite(action_high).all() and (action_high > action_low).all()):
        raise RledError("the action space has no finite bounds", "a Box with finite low < high")
    return Scaling(center, scale, (action_low + action_high) / 2, (action_high - action_low) / 2)


def scaling_of_samples(observations: Floats, action: tuple[Floats, Floats]) -> Scaling:
    """The map that takes observations to mean 0 and standard deviation 1, and action bounds to [−1, 1].

    A component that hardly varies keeps its unit, so that it is not blown up.

    Args:
        observations: demonstrated observations, shape (k, o).
        action: least and greatest action, shape (n,) each.
    """
    std = observations.std(axis=0)
    bounds = scaling_of_bounds((observations.min(axis=0), observations.max(axis=0)), action)
    scale = np.where(std > 1e-6, std, 1.0)
    return Scaling(observations.mean(axis=0), scale, bounds.action_center, bounds.action_scale)


def scaling_of_points(task: TaskDescription, positions: Floats, joints: Floats) -> Scaling:
    """The map of a learner that leaves the demonstrated states but starts at them.

    Lengths are measured in halves of the demonstrated extent, angles in radians, both from the demonstrated mean. The
    deviation of demonstrated states would not do: some joints hardly move in a demonstration, and an exploring robot
    is then hundreds of deviations away.

    Args:
        task: robot and task.
        positions: demonstrated end-effector positions (m), shape (k, 3).
        joints: demonstrated joint angles (rad), shape (k, n).
    """
    axes = list(task.axes)
    extent = float(np.ptp(positions[:, axes], axis=0).max()) / 2.0
    lengths, mean = np.full(len(axes), extent), positions[:, axes].mean(axis=0)
    limit = np.full(task.action_size, task.max_delta)
    if task.observation == "displacement_and_joints":
        center = np.concatenate([np.zeros(len(axes)), joints.mean(axis=0)])
        scale = np.concatenate([lengths, np.ones(task.action_size)])
    else:
        center, scale = np.concatenate([mean, mean]), np.concatenate([lengths, lengths])
    return Scaling(center, scale, np.zeros(task.action_size), limit)
