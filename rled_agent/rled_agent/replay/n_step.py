"""Transitions over n steps (Sutton, 1988), as one buffer in front of another."""

from typing import Any

import torch
from rled_msgs_py.errors import RledError
from torch import Tensor

from rled_agent.replay.replay import Replay
from rled_agent.replay.transitions import Step, Transitions


class NStepReplay(Replay):
    """Joins each step with the n − 1 after it: r = Σₖ γᵏ rₖ, and s' is counted with the product of their discounts.

    What is joined ends where the episode does; nothing is summed across episodes. A step is stored n − 1 steps after it
    was taken, whether its episode has ended or not, so that all seeds store as many.

    Args:
        steps: n.
        replay: what keeps the transitions.
    """

    def __init__(self, steps: int, replay: Replay) -> None:
        self._steps, self._replay = steps, replay
        self._window: list[Step] = []

    def __len__(self) -> int:
        """Transitions held of each seed."""
        return len(self._replay)

    def add(self, step: Step) -> None:
        """Store the step n − 1 before this one, with those that followed it."""
        self._window.append(step)
        if len(self._window) == self._steps:
            self._store()

    def cut(self) -> None:
        """The last step ends its episode."""
        if self._window:
            last = self._window[-1]
            self._window[-1] = last._replace(is_last=torch.ones_like(last.is_last))

    def _store(self) -> None:
        first = self._window[0]
        reward, discount, following = first.reward, first.discount, first.next_observation
        goes_on = ~first.is_last  # (P,)
        for step in self._window[1:]:
            reward = torch.where(goes_on, reward + discount * step.reward, reward)
            discount = torch.where(goes_on, discount * step.discount, discount)
            following = torch.where(goes_on[:, None], step.next_observation, following)
            goes_on = goes_on & ~step.is_last
        del self._window[0]
        self._replay.add(first._replace(reward=reward, discount=discount, next_observation=following))

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
        """Of the buffer behind, and the steps that wait for those after them, shape (P, k, ...)."""
        if not self._window:
            return self._replay.state_dict()
        waiting = {name: torch.stack(columns, dim=1) for name, columns in zip(
            Step._fields, zip(*self._window, strict=True), strict=True
        )}  # fmt: skip
        waiting["is_last"] = waiting["is_last"].to(torch.uint8)
        return self._replay.state_dict() | {f"waiting.{name}": each for name, each in waiting.items()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from ``state``.

        Raises:
            RledError: it is of another buffer, or steps wait that cannot be.
        """
        self._replay.load_state_dict(state)
        self._window = []
        if "waiting.reward" not in state:
            return
        columns = [state[f"waiting.{name}"] for name in Step._fields]
        _require_steps(columns, state["rows"], self._steps)
        steps = zip(*(column.unbind(dim=1) for column in columns), strict=True)
        self._window = [Step(*each)._replace(is_last=each[-1].bool()) for each in steps]


def _require_steps(columns: list[Tensor], rows: Tensor, steps: int) -> None:
    """Refuse what are no steps of such rows."""
    seeds, count = columns[2].shape
    width = sum(column.shape[2] if column.ndim == 3 else 1 for column in columns) - 1
    shapes_fit = all(column.shape[:2] == (seeds, count) for column in columns)
    if count >= steps or not shapes_fit or (seeds, width) != (len(rows), rows.shape[2]):
        raise RledError(f"{count} steps that wait, {width} numbers each", f"{steps - 1} at most, of the replay's sizes")
