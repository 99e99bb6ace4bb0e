"""Shaping by a potential, which leaves the best policy as it is (Ng et al., 1999)."""

from typing import Any, Protocol

import torch
from rled_msgs_py.task import TaskDescription
from torch import Tensor

from rled_agent.nn.scaling import Scaling
from rled_agent.replay.replay import Sampler
from rled_agent.replay.transitions import Transitions


class Potential(Protocol):
    """How good a state is held to be."""

    def __call__(self, observation: Tensor) -> Tensor:
        """φ(s) of normalised observations, shape (P, b, o); shape (P, b, 1)."""
        ...


class ShapedSampler(Sampler):
    """Pays F = γⁿ φ(s') − φ(s) besides; nothing follows a state that ends the task, so φ is 0 there.

    Summed over a trajectory it is what the potentials of its ends differ by, over one step as over n.

    Args:
        sampler: where the transitions come from.
        potential: φ.
    """

    def __init__(self, sampler: Sampler, potential: Potential) -> None:
        self._sampler, self._potential = sampler, potential

    def __len__(self) -> int:
        """Transitions held."""
        return len(self._sampler)

    def sample(self, size: int) -> Transitions:
        """Draw transitions."""
        drawn = self._sampler.sample(size)
        with torch.no_grad():
            gained = drawn.discount * self._potential(drawn.next_observation) - self._potential(drawn.observation)
        return drawn._replace(reward=drawn.reward + gained)

    def update_priorities(self, indices: Tensor, td_error: Tensor) -> None:
        """As of the sampler behind."""
        self._sampler.update_priorities(indices, td_error)

    def state_dict(self) -> dict[str, Any]:
        """Of the sampler behind."""
        return self._sampler.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``."""
        self._sampler.load_state_dict(state)


class DistancePotential(Potential):
    """φ(s) = −w ‖X_T − X‖: nearer to the target is better.

    Args:
        task: says where position and target stand in an observation.
        scaling: of observations.
        weight: w (1/m).
    """

    def __init__(self, task: TaskDescription, scaling: Scaling, weight: float) -> None:
        self._axes, self._weight = len(task.axes), weight
        self._is_relative = task.observation == "displacement_and_joints"
        self._center = torch.from_numpy(scaling.observation_center.astype("float32"))
        self._scale = torch.from_numpy(scaling.observation_scale.astype("float32"))

    def __call__(self, observation: Tensor) -> Tensor:
        """φ(s), shape (P, b, 1)."""
        m, physical = self._axes, observation * self._scale.to(observation) + self._center.to(observation)
        away = physical[..., :m] if self._is_relative else physical[..., m : 2 * m] - physical[..., :m]
        distance: Tensor = away.norm(dim=-1, keepdim=True)
        return -self._weight * distance
