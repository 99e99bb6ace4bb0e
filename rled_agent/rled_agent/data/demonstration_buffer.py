"""Demonstrated transitions with the rewards that the task's own function gives them."""

import numpy as np
import torch
from rled_msgs_py.task import TaskDescription
from rled_sim.tasks import task_of_description

from rled_agent.data.demonstrations import Demonstrations
from rled_agent.nn.scaling import Scaling
from rled_agent.replay.replay import Sampler
from rled_agent.replay.transitions import Source, Transitions


class DemonstrationBuffer(Sampler):
    """Draws batches in which the demonstrator acts.

    A reached target ends the episode where that was seen in the demonstration. Where it was not, or where the
    demonstration's episodes were of another number of targets, it ends with the probability that it is the last one,
    since a state does not tell how many came before it.

    Args:
        demonstrations: what was shown.
        task: what is paid, and when an episode ends: of the environment that is learned in.
        scaling: of the transitions.
        gamma: γ.
        generator: draws.

    Raises:
        RledError: a robot without a task, of whose states nobody knows what is paid.
    """

    def __init__(
        self,
        demonstrations: Demonstrations,
        task: TaskDescription,
        scaling: Scaling,
        gamma: float,
        generator: np.random.Generator,
    ) -> None:
        self._demonstrations, self._task, self._reach = demonstrations, task, task_of_description(task)
        self._scaling, self._gamma, self._generator = scaling, gamma, generator

    def __len__(self) -> int:
        """Number of demonstrated transitions."""
        return len(self._demonstrations)

    def sample(self, size: int) -> Transitions:
        """Draw transitions, normalised; one has no place of its own, and its index is 0."""
        task, scaling = self._task, self._scaling
        moves = self._demonstrations.moves(size, self._generator)
        judged = self._reach.judge(moves.next_q, moves.next_position, moves.target)
        is_last = self._generator.random(size) * max(task.targets_per_episode, 1) < 1.0
        if self._demonstrations.task.targets_per_episode == task.targets_per_episode:
            is_last = np.where(np.isnan(moves.final), is_last, moves.final == 1.0)
        terminated = judged.reached & is_last & (task.targets_per_episode > 0)
        discount = self._gamma * (1.0 - terminated)
        return Transitions(
            torch.from_numpy(scaling.normalize_observation(task.observe(moves.q, moves.position, moves.target))),
            torch.from_numpy(scaling.normalize_action(moves.action)),
            _column(judged.reward),
            _column(discount),
            torch.from_numpy(
                scaling.normalize_observation(task.observe(moves.next_q, moves.next_position, moves.next_target))
            ),
            torch.full((size, 1), float(Source.DEMONSTRATION)),
            torch.ones(size, 1),
            torch.zeros(size, dtype=torch.int64),
        )


def _column(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))[:, None]
