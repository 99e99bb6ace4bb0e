"""Observations and actions in the units that networks see (4.1.3: both are normalised)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription
from torch import Tensor

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

    def observation_into(self, other: "Scaling") -> tuple[Floats, Floats]:
        """Factor and offset, shape (o,) each, from an observation normalised by this to one normalised by another."""
        return _into(
            (self.observation_center, self.observation_scale), (other.observation_center, other.observation_scale)
        )

    def action_into(self, other: "Scaling") -> tuple[Floats, Floats]:
        """Factor and offset, shape (n,) each, from an action normalised by this to one normalised by another."""
        return _into((self.action_center, self.action_scale), (other.action_center, other.action_scale))


def _into(one: tuple[Floats, Floats], other: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    return one[1] / other[1], (one[0] - other[0]) / other[1]


class Affine:
    """Maps x to a x + b in float64, with factors and offsets of each of P seeds.

    Args:
        maps: a and b, shape (k,) each, of each seed.
        device: of the tensors mapped.
    """

    def __init__(self, maps: Sequence[tuple[Floats, Floats]], device: torch.device | str = "cpu") -> None:
        factor, offset = (np.stack(each)[:, None] for each in zip(*maps, strict=True))  # (P, 1, k)
        self._is_identity = bool((factor == 1.0).all() and (offset == 0.0).all())
        self._factor, self._offset = (torch.from_numpy(each).to(device) for each in (factor, offset))

    def __call__(self, x: Tensor) -> Tensor:
        """Of (P, k) or (P, b, k), as float32."""
        if self._is_identity:
            return x
        factor, offset = (each if x.ndim == 3 else each[:, 0] for each in (self._factor, self._offset))
        return torch.addcmul(offset, x.double(), factor).float()


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
