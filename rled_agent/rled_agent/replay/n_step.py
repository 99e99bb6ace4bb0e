"""Transitions over n steps (Sutton, 1988), as one buffer in front of another."""

from collections import deque
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rled_msgs_py.errors import RledError
from torch import Tensor

from rled_agent.replay.replay import Replay
from rled_agent.replay.transitions import Source, Step, Transitions

KEPT = Step._fields[:-1]
"""Of a waiting step: the window of an episode that has ended is empty."""


class NStepReplay(Replay):
    """Joins each step with the n − 1 after it: r = Σₖ γᵏ rₖ, and s' is counted with the product of their discounts.

    A window ends early where the episode does; nothing is summed across episodes.

    Args:
        steps: n.
        replay: what keeps the transitions.
    """

    def __init__(self, steps: int, replay: Replay) -> None:
        self._steps, self._replay = steps, replay
        self._window: deque[Step] = deque()

    def __len__(self) -> int:
        """Transitions held."""
        return len(self._replay)

    def add(self, step: Step) -> None:
        """Store one step of an episode, once those that follow it are known."""
        self._window.append(step)
        if len(self._window) == self._steps:
            self._store()
        if step.is_last:
            self.cut()

    def cut(self) -> None:
        """Store what waits over the steps that there are."""
        while self._window:
            self._store()

    def _store(self) -> None:
        reward, discount = 0.0, 1.0
        for step in self._window:
            reward += discount * step.reward
            discount *= step.discount
        first, last = self._window.popleft(), step
        self._replay.add(first._replace(reward=reward, discount=discount, next_observation=last.next_observation))

    def extend(self, transitions: Transitions) -> None:
        """Store transitions as they are."""
        self._replay.extend(transitions)

    def sample(self, size: int) -> Transitions:
        """Draw transitions."""
        return self._replay.sample(size)

    def update_priorities(self, indices: Tensor, td_error: Tensor) -> None:
        """As of the buffer behind."""
        self._replay.update_priorities(indices, td_error)

    def state_dict(self) -> dict[str, Any]:
        """Of the buffer behind, and the steps that wait for those after them."""
        waiting = {f"waiting.{name}": _column([getattr(step, name) for step in self._window]) for name in KEPT}
        return self._replay.state_dict() | waiting

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is of another buffer, or steps wait that cannot be.
        """
        columns = {name: state[f"waiting.{name}"].numpy() for name in KEPT}
        _require_steps(columns, state["rows"].shape[-1], self._steps)
        self._replay.load_state_dict(state)
        self._window = deque(
            Step(s, a, float(r), float(d), following, Source(int(source)))
            for s, a, r, d, following, source in zip(*columns.values(), strict=True)
        )


def _require_steps(columns: dict[str, NDArray[np.floating]], width: int, steps: int) -> None:
    """Refuse what are no steps of rows of such a width."""
    count = len(columns["reward"])
    state, action = columns["observation"], columns["action"]
    are_flat = all(columns[name].shape == (count,) for name in ("reward", "discount", "source"))
    are_rows = (
        state.shape == columns["next_observation"].shape and (2 * state.shape[-1] + action.shape[-1] + 3) == width
    )
    are_sources = set(columns["source"].ravel().tolist()) <= set(Source)
    if count >= steps or not are_flat or not are_sources or (count and not are_rows):
        raise RledError(
            f"{count} steps that wait, of shape {state.shape}", f"{steps - 1} at most, of the replay's sizes"
        )


def _column(values: list[Any]) -> Tensor:
    """Of arrays, which are of float32, or of numbers, whose sum is rounded once: they keep all their bits."""
    return torch.from_numpy(np.array(values, dtype=np.float32 if values and np.ndim(values[0]) else np.float64))
