"""Expert transitions with rewards, straight from ζᵇ in closed form."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rled_agent.demonstrations import DemonstrationError, JoinedPoints
from rled_agent.nn.scaling import Scaling


@dataclass(frozen=True, eq=False)
class ExpertRows:
    """Draws rows of a replay buffer in which the demonstrator acts.

    The next state of a reached target has a new target, drawn as the task draws it. A reached target ends the
    episode with the probability that it is the last one, since a state does not tell how many came before it.

    Attributes:
        demonstrations: ζᵇ.
        scaling: of the rows.

    Raises:
        DemonstrationError: points so near to each other that no transition leads to a target not yet reached.
    """

    demonstrations: JoinedPoints
    scaling: Scaling

    def __post_init__(self) -> None:
        points, tolerance = self.demonstrations.points.positions, self.demonstrations.task.tolerance
        if (_squared(points - points[0]) < tolerance).all():
            what = "all marked points lie within the tolerance of one target"
            raise DemonstrationError(what, f"points {tolerance**0.5:.3g} m apart or more", "mark more of the curve")

    def sample(self, size: int, generator: np.random.Generator) -> Tensor:
        """Rows (s, a, r, terminated, s'), normalised as in ``Replay``, shape (size, 2o + n + 2)."""
        zeta, task = self.demonstrations, self.demonstrations.task
        drawn = zeta.draw(size, generator)
        while (arrived := _squared(drawn.position - drawn.target) < task.tolerance).any():
            drawn = drawn.replaced(arrived, zeta.draw(int(arrived.sum()), generator))
        q = drawn.q + drawn.action
        position = zeta.chain.position(q)
        squared = _squared(position - drawn.target)
        reached = squared < task.tolerance
        reward = np.where(reached, task.reward_reached, 0.0) - (squared if task.reward == "dense" else 0.0)
        points = zeta.points.positions
        following = np.where(reached[:, None], points[generator.integers(len(points), size=size)], drawn.target)
        last = generator.random(size) * max(task.targets_per_episode, 1) < 1.0
        columns = (
            self.scaling.normalize_observation(task.observe(drawn.q, drawn.position, drawn.target)),
            self.scaling.normalize_action(drawn.action),
            reward[:, None],
            (reached & last & (task.targets_per_episode > 0))[:, None],
            self.scaling.normalize_observation(task.observe(q, position, following)),
        )
        return torch.from_numpy(np.concatenate(columns, axis=1).astype(np.float32))


def _squared(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    squared: NDArray[np.float64] = np.square(vectors).sum(axis=1)
    return squared
