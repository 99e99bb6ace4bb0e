"""Demonstrated transitions with the rewards that the task's own function gives them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from rled_msgs_py.errors import RledError
from rled_msgs_py.task import TaskDescription
from rled_sim.tasks import task_of_description

from rled_agent.data.demonstrations import Demonstrations, Floats
from rled_agent.nn.scaling import Scaling
from rled_agent.per_seed import of_seed
from rled_agent.replay.replay import Sampler
from rled_agent.replay.transitions import Source, Transitions, transitions_of

BLOCK = 4096
"""Transitions of each seed drawn at once, in whole batches: the closed form of ζᵇ is cheapest in large arrays."""
MAX_SIZE = 1_000_000
"""Transitions in a batch."""
STREAM = 2
"""Tells the generator of demonstrations from others of the same seed."""


class DemonstrationBuffer(Sampler):
    """Draws batches in which the demonstrator acts, for each seed its own.

    A reached target ends the episode where that was seen in the demonstration. Where it was not, or where the
    demonstration's episodes were of another number of targets, it ends with the probability that it is the last one,
    since a state does not tell how many came before it.

    Args:
        demonstrations: what was shown.
        task: what is paid, and when an episode ends: of the environment that is learned in.
        scaling: of the transitions.
        gamma: γ, or that of each seed, shape (P,).
        seeds: of the draws.
        device: of the batches.

    Raises:
        RledError: a robot without a task, of whose states nobody knows what is paid.
    """

    def __init__(
        self,
        demonstrations: Demonstrations,
        task: TaskDescription,
        scaling: Scaling,
        gamma: float,
        seeds: Sequence[int],
        device: torch.device | str = "cpu",
    ) -> None:
        self._demonstrations, self._task, self._reach = demonstrations, task, task_of_description(task)
        self._scaling, self._gamma, self._seeds, self._device = scaling, gamma, seeds, device
        self._block = self._size = self._used = 0
        self._rows = torch.empty(len(seeds), 0)

    def __len__(self) -> int:
        """Number of demonstrated transitions."""
        return len(self._demonstrations)

    def sample(self, size: int) -> Transitions:
        """Draw transitions, normalised; one has no place of its own, and its index is 0."""
        if size != self._size or self._used + size > self._rows.shape[1]:
            self._draw(size)
            self._block, self._used = self._block + 1, 0
        rows = self._rows[:, self._used : self._used + size]
        self._used += size
        index = torch.zeros(rows.shape[:2], dtype=torch.int64, device=rows.device)
        return transitions_of(rows, len(self._scaling.observation_scale), len(self._scaling.action_scale), index)

    def _draw(self, size: int) -> None:
        """The batches of a block, which its number alone decides."""
        count = size * max(BLOCK // size, 1)
        rows = [self._rows_of(k, count) for k in range(len(self._seeds))]
        self._rows, self._size = torch.from_numpy(np.stack(rows)).to(self._device), size

    def _rows_of(self, seed: int, count: int) -> np.ndarray:
        """Transitions of one seed, as a replay keeps them, shape (count, 2 o + n + 3)."""
        generator = np.random.default_rng([self._seeds[seed], STREAM, self._block])
        task, scaling = self._task, self._scaling
        moves = self._demonstrations.moves(count, generator)
        judged = self._reach.judge(moves.next_q, moves.next_position, moves.target)
        is_last = generator.random(count) * max(task.targets_per_episode, 1) < 1.0
        if self._demonstrations.task.targets_per_episode == task.targets_per_episode:
            is_last = np.where(np.isnan(moves.final), is_last, moves.final == 1.0)
        terminated = judged.reached & is_last & (task.targets_per_episode > 0)
        columns = (
            scaling.normalize_observation(task.observe(moves.q, moves.position, moves.target)),
            scaling.normalize_action(moves.action),
            _column(judged.reward),
            _column(of_seed(self._gamma, seed) * (1.0 - terminated)),
            scaling.normalize_observation(task.observe(moves.next_q, moves.next_position, moves.next_target)),
            np.full((count, 1), float(Source.DEMONSTRATION), dtype=np.float32),
        )
        return np.concatenate(columns, axis=1, dtype=np.float32)

    def state_dict(self) -> dict[str, Any]:
        """Where in its draws it is."""
        return {"block": self._block, "size": self._size, "used": self._used}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is no place in the draws.
        """
        block, size, used = (state[name] for name in ("block", "size", "used"))
        counts = (block, size, used)
        if any(not isinstance(each, int) or each < 0 for each in counts) or size > MAX_SIZE:
            raise RledError(f"demonstrations at {str(counts)[:80]}", "a place in their draws")
        if block:
            self._block = block - 1
            self._draw(max(size, 1))
        self._block, self._used = block, used


def _column(values: Floats) -> np.ndarray:
    return np.asarray(values, dtype=np.float32)[:, None]
